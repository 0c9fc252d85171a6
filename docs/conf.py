"""The site: `sphinx-build -W -b html docs site` (the extra docs); tutorials are run as it is built."""

import logging
import os
import re
from pathlib import Path

from skfem_peridynamics import __version__

os.environ["PYVISTA_OFF_SCREEN"] = "true"
os.environ.pop("DISPLAY", None)
logging.getLogger("skfem").setLevel(logging.WARNING)  # it tells of each assembly
HERE = Path(__file__).parent
project, author, release = "skfem-peridynamics", "the skfem-peridynamics authors", __version__
copyright = author
extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
]
html_theme = "furo"
html_title = f"{project} {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
templates_path = ["templates"]
exclude_patterns = ["templates", "benchmarks", "tutorials", "evidence/study/*.md"]
nitpicky = False
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
suppress_warnings = ["config.cache"]
autosummary_generate = True
autosummary_ignore_module_all = False
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
autodoc_typehints = "none"
autodoc_member_order = "bysource"
add_module_names = False
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

sphinx_gallery_conf = {
    "examples_dirs": ["tutorials"],
    "gallery_dirs": ["learn"],
    "filename_pattern": r"/\d_",
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("matplotlib",),
    "remove_config_comments": True,
    "download_all_examples": False,
    "show_signature": False,
    "abort_on_example_error": True,
    "min_reported_time": 10_000,
    "capture_repr": ("_repr_html_", "__repr__"),
    "reset_modules": ("matplotlib",),
}

# what the documents link to outside of docs/: pages of the site, or the name alone where the site has none
_WHOLE = {"start/readme": "README.md", "changes": "CHANGELOG.md", "contribute": "CONTRIBUTING.md"}
_PAGES = {"README.md": "/start/readme.md", "CHANGELOG.md": "/changes.md", "CONTRIBUTING.md": "/contribute.md"}
_LINK = re.compile(
    r"\[([^\]\n]*(?:\n[^\]\n]*)?)\]\(((?:\.\./|README\.md|CHANGELOG\.md|CONTRIBUTING\.md|docs/|examples/|study\b|validation/|benchmarks/)[^)\s]*)\)"
)


def _rewritten(app, docname, source):
    """Send links of the repository to pages of the site."""

    def one(match):
        text, target = match[1], match[2]
        path, _, anchor = target.partition("#")
        place = (HERE / docname).parent / path if docname not in _WHOLE else HERE.parent / path
        place = place.resolve()
        name = place.relative_to(HERE.parent.resolve()).as_posix()
        if name in _PAGES:
            return f"[{text}]({_PAGES[name]}{'#' + anchor if anchor else ''})"
        inside = place.is_file() and HERE.resolve() in place.parents
        if inside and place.suffix == ".md" and "study" not in place.parts:
            return f"[{text}](/{place.relative_to(HERE.resolve()).as_posix()}{'#' + anchor if anchor else ''})"
        if inside and place.suffix in (".png", ".csv"):
            return match[0]
        return f"{text} (`{name}`)" if text.strip("`") not in name else f"`{name}`"

    source[0] = _LINK.sub(one, source[0])


def _read_whole(app, docname, source):
    """Pages that are files of the repository."""
    if docname in _WHOLE:
        source[0] = (HERE.parent / _WHOLE[docname]).read_text(encoding="utf-8")
        source[0] = source[0].replace("](docs/glass_branching.png)", "](/glass_branching.png)")
    _rewritten(app, docname, source)


def setup(app):
    app.connect("source-read", _read_whole)
