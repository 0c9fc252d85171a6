"""Pictures by matplotlib, loaded where one is drawn: what all share, and those of studies."""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..files.whole_files import write_whole


def available() -> bool:
    """Return whether matplotlib is installed, without importing it."""
    from importlib.util import find_spec

    return find_spec("matplotlib") is not None


def for_phone() -> bool:
    """Return whether what is drawn now is for a phone: with large letters, and little beside one another."""
    return bool(_PHONE)


def new_figure(width: float, height: float) -> Any:
    """Return a figure of so many inches that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    if _PHONE:
        import matplotlib

        matplotlib.rcParams["font.size"] = _LETTERS * width
        height *= _TALLER
    figure = Figure(figsize=(width, height), dpi=_DPI[bool(_PHONE)], layout="constrained")
    FigureCanvasAgg(figure)
    return figure


@contextlib.contextmanager
def own_style(phone: bool = False) -> Iterator[None]:
    """Draw as matplotlib does where nobody has set anything: it obeys a file in the working folder.

    For a ``phone`` letters grow with the figure: shrunk to the width of a screen of 390 px they have 12 px or more.
    """
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        _PHONE.extend([True] * phone)
        try:
            yield
        finally:
            _PHONE.clear()


# points of a letter for an inch of the figure: the smallest, "x-small", has 0.69 of them, 12 px on a figure of 361 px
_LETTERS, _TALLER = 3.45, 1.3
_PHONE: list[bool] = []
_DPI = 150, 100  # dots an inch, and on a phone, whose screen shows no more of them
_LEVEL = 3  # of zlib: half the time of the usual 6, pictures a tenth larger


def save(figure: Any, path: Path) -> None:
    """Write a figure as PNG, aside and renamed. No text in it is taken for mathematics."""
    content = io.BytesIO()
    with warnings.catch_warnings():
        # a title may use letters that the font lacks: boxes are drawn for them
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        _number_plainly(figure)
        for text in figure.findobj(_is_text):
            text.set_parse_math(False)
        figure.savefig(content, format="png", pil_kwargs={"compress_level": _LEVEL})
    write_whole(path, content.getvalue())


def _number_plainly(figure: Any) -> None:
    """Number logarithmic axes without mathematics."""
    from matplotlib.ticker import LogFormatter, StrMethodFormatter

    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis) if axis.get_scale() == "log"):
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(LogFormatter(labelOnlyBase=False, minor_thresholds=(1.0, 0.4)))


def _is_text(artist: Any) -> bool:
    return hasattr(artist, "set_parse_math")
