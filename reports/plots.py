"""Plots of speed against error and of scaling: readable in black and white, axes with units."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

PANELS = {
    "driving_forces": "Driving forces",
    "all_reactions": "Driving forces and all reactions",
    "forward_step": "Accelerations from forces",
    "simulate": "One second of motion",
}
COLOURS = ("#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f7f")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*")
LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 3)))
STYLE: dict[str, Any] = {
    "font.size": 10,
    "axes.grid": True,
    "grid.alpha": 0.35,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "path",
    "legend.frameon": False,
}
ROUNDING = 2.0**-53
FLOOR = 1e-18
"""Smallest error that is drawn: a perfect answer has none."""


class Plot(NamedTuple):
    """A figure as files."""

    svg: str
    png: bytes


def draw(speed_error: pd.DataFrame, scaling: pd.DataFrame, baseline: float) -> dict[str, Plot]:
    """All plots by name; one without anything to show is left out. ``baseline``: µs of the yardstick, or NaN."""
    with mpl.rc_context(STYLE):
        figures = {
            "work_precision": work_precision(speed_error, baseline),
            "scaling": over_samples(scaling),
            "legs": over_legs(scaling),
        }
        return {name: _files(name, figure) for name, figure in figures.items() if figure.axes}


def _files(name: str, figure: Figure) -> Plot:
    svg, png = io.StringIO(), io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": name}):  # the same plot is the same file, and two on a page share no names
        figure.savefig(svg, format="svg", bbox_inches="tight", metadata={"Date": None, "Creator": None})
    figure.savefig(png, format="png", dpi=130, bbox_inches="tight", metadata={"Software": None})
    text = svg.getvalue()
    return Plot(text[text.index("<svg") :], png.getvalue())


def styles(methods: Iterable[tuple[str, ...]]) -> dict[tuple[str, ...], dict[str, Any]]:
    """Colour, marker and line of each method, engine by engine: no two are alike without colour either."""
    return {
        method: {
            "color": COLOURS[k % len(COLOURS)],
            "marker": MARKERS[k % len(MARKERS)],
            "linestyle": LINES[k % len(LINES)],
            "markersize": 5.5,
            "linewidth": 1.2,
        }
        for k, method in enumerate(dict.fromkeys(methods))
    }


def _methods(rows: pd.DataFrame) -> list[tuple[str, ...]]:
    names = rows[["engine", "route", "backend"]].fillna("").itertuples(index=False)
    return [tuple(map(str, name)) for name in names]


def _of(rows: pd.DataFrame, method: tuple[str, ...]) -> pd.DataFrame:
    return rows[[found == method for found in _methods(rows)]]


def _range(values: Iterable[Any]) -> str:
    ends = list(dict.fromkeys(values))
    return str(ends[0]) if len(ends) == 1 else f"{ends[0]} … {ends[-1]}"


def _legend(method: tuple[str, ...], rows: pd.DataFrame) -> str:
    """Method, its settings from the first to the last, and its batches."""
    text = " ".join(part for part in method if part)
    settings, batches = _range(rows["setting"]), [_power(b) for b in sorted(rows["batch"].unique())]
    return f"{text}\n  {settings}" + (f"\n  batch {_range(batches)}" if len(batches) > 1 or batches != ["1"] else "")


def _power(batch: int) -> str:
    return f"$10^{{{round(np.log10(batch))}}}$" if batch >= 1000 else str(batch)


def work_precision(table: pd.DataFrame, baseline: float) -> Figure:
    """Error over time per sample, one panel per task, one curve per method; hollow marks take one sample at a time."""
    table = table[table["max_rel_error"].notna() & table["us_per_sample"].notna()]
    tasks = [task for task in PANELS if (table["task"] == task).any()]
    figure = Figure(figsize=(8.5, 4.6 * len(tasks)), layout="constrained")
    if not tasks:
        return figure
    style = styles(_methods(table))
    for axes, task in zip(np.atleast_1d(figure.subplots(len(tasks), 1)), tasks, strict=True):
        rows = table[table["task"] == task]
        for method in dict.fromkeys(_methods(rows)):
            _curve(axes, _of(rows, method), style[method], _legend(method, _of(rows, method)))
        axes.axhline(ROUNDING, color="0.5", linewidth=0.8, linestyle=":")
        if task != "simulate" and np.isfinite(baseline):
            axes.axvline(baseline, color="0.4", linewidth=1.0, linestyle="--")
            axes.annotate(
                "pin.rnea, open tree", (baseline, 0.98), xycoords=("data", "axes fraction"), xytext=(4, 0),
                textcoords="offset points", rotation=90, va="top", fontsize=8, color="0.3",
            )  # fmt: skip
        unit = "simulated second" if task == "simulate" else "sample"
        axes.set(
            xscale="log", yscale="log", title=PANELS[task], xlabel=f"time per {unit} [µs]",
            ylabel="largest error over scale [1]" if task != "simulate" else "pose error [longest leg, rad]",
        )  # fmt: skip
        axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), fontsize=7.5, labelspacing=0.7, handlelength=3.2)
    return figure


def _curve(axes: Axes, rows: pd.DataFrame, style: Mapping[str, Any], label: str) -> None:
    """Marks of a method; lines join batches of one setting, and settings at the largest batch."""
    x, y = rows["us_per_sample"], rows["max_rel_error"].clip(lower=FLOOR)
    joined = [part.sort_values("batch") for _, part in rows.groupby("setting", sort=False)]
    joined.append(rows[rows["batch"] == rows["batch"].max()].sort_values("us_per_sample"))
    line = {key: style[key] for key in ("color", "linestyle", "linewidth")}
    for part in joined:
        if len(part) > 1:
            axes.plot(part["us_per_sample"], part["max_rel_error"].clip(lower=FLOOR), **line)
    mark = {key: style[key] for key in ("color", "marker", "markersize")} | {"linestyle": ""}
    one = (rows["batch"] == 1).to_numpy()
    axes.plot(x[one], y[one], **mark, markerfacecolor="white")
    axes.plot(x[~one], y[~one], **mark)
    axes.errorbar(
        x, y, xerr=[x - rows["us_p10"].clip(upper=x), rows["us_p90"].clip(lower=x) - x], fmt="none",
        ecolor=style["color"], elinewidth=0.7, alpha=0.6,
    )  # fmt: skip
    axes.plot([], [], **style, label=label)


def over_samples(scaling: pd.DataFrame) -> Figure:
    """Time per sample and memory of a batch over its size, driving forces and all reactions."""
    tasks = [task for task in list(PANELS)[:3] if (scaling["what"] == task).any()]
    figure = Figure(figsize=(4.2 * max(len(tasks), 1), 7.6), layout="constrained")
    rows = scaling[scaling["what"].isin(tasks)]
    if not tasks:
        return figure
    style = styles(_methods(rows))
    panels = figure.subplots(2, len(tasks), sharex=True, sharey="row", squeeze=False)
    for column, task in enumerate(tasks):
        for method in dict.fromkeys(_methods(rows)):
            part = _of(rows[rows["what"] == task], method)
            if len(part):
                part = part[part["setting"] == part["setting"].iloc[-1]].sort_values("batch")
                label = " ".join(name for name in method if name)
                panels[0, column].plot(part["batch"], part["us_per_sample"], **style[method], label=label)
                panels[1, column].plot(part["batch"], part["peak_mb"], **style[method])
        panels[0, column].set(xscale="log", yscale="log", title=PANELS[task])
        panels[1, column].set(xscale="log", yscale="log", xlabel="samples at a time [1]")
    panels[0, 0].set_ylabel("time per sample [µs]")
    panels[1, 0].set_ylabel("memory of a batch [MB]")
    labels = {label: handle for axes in panels[0] for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(labels.values(), labels, loc="outside lower center", ncols=3, fontsize=8.5, handlelength=3.2)
    return figure


def over_legs(scaling: pd.DataFrame) -> Figure:
    """Time per sample of machines by their number of legs."""
    tasks = list(PANELS)
    rows = scaling[~scaling["what"].isin(tasks)]
    figure = Figure(figsize=(6.5, 4.2), layout="constrained")
    if not len(rows):
        return figure
    axes = figure.subplots()
    names = rows["what"].unique()
    style = styles([(name,) for name in names])
    for name in names:
        part = rows[rows["what"] == name].sort_values("legs")
        label = f"{name.replace('_', ' ')}, {part['backend'].iloc[0]}, {part['batch'].iloc[0]} at a time"
        axes.plot(part["legs"], part["us_per_sample"], **style[(name,)], label=label)
        first = part.iloc[0]
        axes.plot(
            part["legs"], first["us_per_sample"] * part["legs"] / first["legs"], color="0.6", linewidth=0.8,
            linestyle=":", label="in proportion to the legs" if name == names[-1] else None,
        )  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="legs [1]", ylabel="time per sample [µs]", title="Number of legs")
    legs = sorted(rows["legs"].unique())
    axes.set_xticks(legs, [str(n) for n in legs])
    axes.minorticks_off()
    axes.legend(loc="upper left", fontsize=8.5)
    return figure
