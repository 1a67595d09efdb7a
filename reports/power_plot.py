"""The plot of detection power: a line for each number of a scene, a mark for each engine and route."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
from matplotlib.figure import Figure

from .drawing import STYLE, Plot, files, styles, words

if TYPE_CHECKING:
    import pandas as pd


def draw(rows: pd.DataFrame) -> Plot:
    """Smallest relative fault detected; what is blind stands at the right edge, hollow."""
    names = list(dict.fromkeys(rows["fault"]))
    look = styles(tuple(key) for key in rows[["engine", "route"]].drop_duplicates().to_numpy())
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.0, 1.2 + 0.19 * len(names)))
        axes = figure.subplots()
        for k, (key, style) in enumerate(look.items()):
            engine, route = key
            part = rows[(rows["engine"] == engine) & (rows["route"] == route)]
            style |= {"linestyle": "none", "markersize": 4.0}
            at = part["fault"].map(names.index) + 0.7 * ((k + 0.5) / len(look) - 0.5)
            axes.plot(part["smallest"], at, label=f"{engine} {route}", **style)
            lost = part["smallest"].isna()
            axes.plot([1.0] * int(lost.sum()), at[lost], fillstyle="none", **style)
        axes.set_xscale("log")
        axes.set_yticks(range(len(names)), [words(name) for name in names], fontsize=7)
        axes.invert_yaxis()
        axes.set_xlabel("smallest relative fault that is detected (hollow, at 1: none is)")
        axes.legend(ncols=2, loc="lower center", bbox_to_anchor=(0.4, 1.0))
        return files("power", figure)
