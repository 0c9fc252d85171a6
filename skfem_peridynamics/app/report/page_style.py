"""How a report looks: readable on a screen, on a phone and on paper, without a font or a script from anywhere."""

STYLE = """
:root { --ink: #1d232b; --soft: #5b6672; --line: #dde2e8; --shade: #f5f7f9; --mark: #b4342d; }
* { box-sizing: border-box; }
body { margin: 0; background: #fff; color: var(--ink); }
body { font: 16px/1.55 system-ui, -apple-system, "Segoe UI", sans-serif; }
main { max-width: 58rem; margin: 0 auto; padding: 1.5rem 1.25rem 4rem; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 1rem 0 0.5rem; }
h2 { font-size: 1.25rem; margin: 2.5rem 0 0.75rem; padding-top: 1rem; border-top: 1px solid var(--line); }
h3 { font-size: 1rem; margin: 1.5rem 0 0.5rem; }
.lead { font-size: 1.1rem; color: var(--soft); margin: 0 0 1.5rem; overflow-wrap: anywhere; }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(8.5rem, 1fr)); }
.cards { gap: 0.75rem; margin: 1rem 0 1.5rem; }
.cards div { background: var(--shade); border-radius: 8px; padding: 0.7rem 0.9rem; }
.cards dt { font-size: 0.8rem; color: var(--soft); }
.cards dd { margin: 0.1rem 0 0; font-size: 1.15rem; font-weight: 600; overflow-wrap: anywhere; }
.date { color: var(--soft); font-size: 0.85rem; margin: -1rem 0 1rem; }
figure { margin: 1.25rem 0; }
img { display: block; width: 46rem; max-width: 100%; height: auto; }
figcaption { font-size: 0.88rem; color: var(--soft); margin-top: 0.4rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: 0.92rem; }
th { text-align: left; font-weight: 500; color: var(--soft); padding: 0.3rem 1.5rem 0.3rem 0; vertical-align: top; }
td { padding: 0.3rem 0; overflow-wrap: anywhere; }
.bar { display: grid; grid-template-columns: 6rem 1fr 5rem; align-items: center; gap: 0.6rem; font-size: 0.9rem; }
.bar i { display: block; height: 0.8rem; min-width: 2px; background: var(--mark); border-radius: 3px; }
.bar b { font-weight: 500; text-align: right; }
pre { background: var(--shade); border-radius: 8px; padding: 0.8rem 1rem; overflow-x: auto; font-size: 0.85rem; }
code, pre { font-family: ui-monospace, "SFMono-Regular", Menlo, Consolas, monospace; }
li { overflow-wrap: anywhere; }
summary { cursor: pointer; color: var(--mark); }
@media (max-width: 34rem) {
  main { padding: 1rem 0.9rem 3rem; }
  h1 { font-size: 1.5rem; }
  table, tbody { display: block; width: 100%; }
  tr { display: block; padding: 0.25rem 0; border-bottom: 1px solid var(--line); }
  th, td { display: block; padding: 0; }
}
@media print { main { max-width: none; } figure, .cards { break-inside: avoid; } }
"""
