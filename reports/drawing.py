"""What all plots share: colours, marks, lines, the style, and figures as files."""

from __future__ import annotations

import io
from collections.abc import Iterable
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure

COLOURS = {
    "analytic": "#000000",
    "mujoco": "#0072b2",
    "pinocchio": "#d55e00",
    "dart": "#009e73",
    "reference": "#cc79a7",
}
OTHERS = "#e69f00"
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*", "p", "h", "d", "8")
LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 3)))
STYLE: dict[Any, Any] = {
    "font.size": 10,
    "axes.grid": True,
    "grid.alpha": 0.35,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "path",
    "legend.frameon": False,
}
ROUNDING = 2.0**-53


class Plot(NamedTuple):
    """A figure as files."""

    svg: str
    png: bytes


def files(name: str, figure: Figure) -> Plot:
    """A figure as SVG text and PNG bytes; its name keeps it apart from the others of a page."""
    svg, png = io.StringIO(), io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": name}):  # the same plot is the same file, and two on a page share no names
        figure.savefig(svg, format="svg", bbox_inches="tight", metadata={"Date": None, "Creator": None})
    figure.savefig(png, format="png", dpi=130, bbox_inches="tight", metadata={"Software": None})
    text = svg.getvalue()
    return Plot(text[text.index("<svg") :], png.getvalue())


def styles(found: Iterable[tuple[str, ...]]) -> dict[tuple[str, ...], dict[str, Any]]:
    """Colour by engine, the first name of a method; marker and line by method: no two are alike in black and white."""
    return {
        method: {
            "color": COLOURS.get(method[0], OTHERS),
            "marker": MARKERS[k % len(MARKERS)],
            "linestyle": LINES[k % len(LINES)],
            "markersize": 5.5,
            "linewidth": 1.2,
        }
        for k, method in enumerate(dict.fromkeys(found))
    }


def words(text: object) -> str:
    """A text as it is: a dollar sign begins no formula."""
    return str(text).replace("$", r"\$")
