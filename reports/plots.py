"""Plots of speed against error and of scaling: readable in black and white, axes with units."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from .drawing import ROUNDING, STYLE, Plot, files, styles

PANELS = {
    "driving_forces": "Driving forces",
    "all_reactions": "Driving forces and all reactions",
    "forward_step": "Accelerations from forces",
    "simulate": "One second of motion",
}
FLOOR = 1e-18
"""Smallest error that is drawn: a perfect answer has none."""


def draw(speed_error: pd.DataFrame, scaling: pd.DataFrame, baseline: float) -> dict[str, Plot]:
    """All plots by name; one without anything to show is left out. ``baseline``: µs of the yardstick, or NaN."""
    with mpl.rc_context(STYLE):
        figures = {
            "work_precision": work_precision(speed_error, baseline),
            "scaling": over_samples(scaling),
            "legs": over_legs(scaling),
        }
        return {name: files(name, figure) for name, figure in figures.items() if figure.axes}


KNOB = r", ([a-z]+ [\d.][^,]*)$"
"""The end of a setting that is a knob: a name and a number."""

Method = tuple[str, ...]
"""Engine, route, back end, and what its settings have in common."""


def methods(rows: pd.DataFrame) -> pd.Series:
    """Method of each row: a setting may end with its knob, after a comma, a name and a number."""
    family = rows["setting"].fillna("").str.replace(KNOB, "", regex=True)
    names = [rows[name].fillna("").astype(str) for name in ("engine", "route", "backend")]
    return pd.Series(list(zip(*names, family, strict=True)), index=rows.index, dtype=object)


def _range(values: Iterable[Any]) -> str:
    ends = list(dict.fromkeys(values))
    return str(ends[0]) if len(ends) == 1 else f"{ends[0]} … {ends[-1]}"


def _legend(method: Method, rows: pd.DataFrame) -> str:
    """Method, its knob from the first to the last, and its batches."""
    knobs = [found[1] for s in rows["setting"] if (found := re.search(KNOB, s))]
    batches = [_power(b) for b in sorted(rows["batch"].unique())]
    ranges = [_range(knobs)] if knobs else []
    ranges += [f"batch {_range(batches)}"] if batches != ["1"] else []
    return f"{' '.join(part for part in method[:3] if part)}: {method[3]}" + "".join(f"\n   {x}" for x in ranges)


def _power(batch: int) -> str:
    return f"$10^{{{round(np.log10(batch))}}}$" if batch >= 1000 else str(batch)


def work_precision(table: pd.DataFrame, baseline: float) -> Figure:
    """Error over time per sample, one panel per task, one curve per method; hollow marks take one sample at a time."""
    table = table[table["max_rel_error"].notna() & table["us_per_sample"].notna()]
    tasks = [task for task in PANELS if (table["task"] == task).any()]
    height = 5.0 * max(len(tasks), 1)
    figure = Figure(figsize=(11.0, height))
    if not tasks:
        return figure
    figure.subplots_adjust(left=0.08, right=0.66, bottom=0.6 / height, top=1.0 - 0.4 / height, hspace=0.34)
    for axes, task in zip(np.atleast_1d(figure.subplots(len(tasks), 1)), tasks, strict=True):
        rows = table[table["task"] == task]
        unit = 1e-6 if task == "simulate" else 1.0
        rows = rows.assign(**{name: rows[name] * unit for name in ("us_per_sample", "us_p10", "us_p90")})
        which = methods(rows)
        for method, style in styles(which).items():
            _curve(axes, rows[which == method], style, _legend(method, rows[which == method]))
        axes.axhline(ROUNDING, color="0.5", linewidth=0.8, linestyle=":")
        axes.set(xscale="log", yscale="log", title=PANELS[task])
        if task == "simulate":
            axes.set(xlabel="time per simulated second [s]", ylabel="largest error of the pose [longest leg, rad]")
        else:
            axes.set(xlabel="time per sample [µs]", ylabel="largest error over scale [1]")
            axes.set_ylim(bottom=ROUNDING / 5.0, top=max(axes.get_ylim()[1], 1e-13))
            if np.isfinite(baseline):
                _yardstick(axes, baseline)
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), fontsize=8, labelspacing=0.6, handlelength=3.4)
    return figure


def _yardstick(axes: Axes, baseline: float) -> None:
    axes.axvline(baseline, color="0.4", linewidth=1.0, linestyle="--")
    axes.annotate(
        "pin.rnea, open tree", (baseline, 0.98), xycoords=("data", "axes fraction"), xytext=(4, 0),
        textcoords="offset points", rotation=90, va="top", fontsize=8, color="0.3",
    )  # fmt: skip


def _curve(axes: Axes, rows: pd.DataFrame, style: Mapping[str, Any], label: str) -> None:
    """Marks of a method; lines join the batches of a setting, and the settings of the batch that has most of them."""
    x, y = rows["us_per_sample"], rows["max_rel_error"].clip(lower=FLOOR)
    joined = [part.sort_values("batch").index for _, part in rows.groupby("setting", sort=False)]
    joined.append(rows[rows["batch"] == rows["batch"].mode().iloc[0]].index)
    line: dict[str, Any] = {key: style[key] for key in ("color", "linestyle", "linewidth")}
    for part in joined:
        if len(part) > 1:
            axes.plot(x[part], y[part], **line)
    mark: dict[str, Any] = {key: style[key] for key in ("color", "marker", "markersize")} | {"linestyle": ""}
    one = rows["batch"] == 1
    axes.plot(x[one], y[one], **mark, markerfacecolor="white")
    axes.plot(x[~one], y[~one], **mark)
    axes.errorbar(
        x, y, xerr=[x - rows["us_p10"].clip(upper=x), rows["us_p90"].clip(lower=x) - x], fmt="none",
        ecolor=style["color"], elinewidth=0.7, alpha=0.6,
    )  # fmt: skip
    axes.plot([], [], **style, label=label, markerfacecolor="white" if one.all() else style["color"])


def over_samples(scaling: pd.DataFrame) -> Figure:
    """Time per sample and memory of a batch over its size, each task and method that takes batches."""
    which = methods(scaling)
    sizes = scaling.groupby([scaling["what"], which])["batch"].transform("nunique")
    rows, which = scaling[sizes > 1], which[sizes > 1]
    tasks = [task for task in PANELS if (rows["what"] == task).any()]
    figure = Figure(figsize=(4.2 * max(len(tasks), 1), 7.8), layout="constrained")
    if not tasks:
        return figure
    style = styles(_in_short(method) for method in which)
    panels = figure.subplots(2, len(tasks), sharex=True, sharey="row", squeeze=False)
    labels = {}
    for (top, bottom), task in zip(panels.T, tasks, strict=True):
        for method in dict.fromkeys(which[rows["what"] == task]):
            part = rows[(rows["what"] == task) & (which == method)]
            part = part[part["setting"] == part["setting"].iloc[-1]].sort_values("batch")
            short = _in_short(method)
            (labels[" ".join(name for name in short if name)],) = top.plot(
                part["batch"], part["us_per_sample"], **style[short]
            )
            bottom.plot(part["batch"], part["peak_mb"], **style[short])
        top.set(xscale="log", yscale="log", title=PANELS[task])
        bottom.set(xscale="log", yscale="log", xlabel="samples at a time [1]")
    panels[0, 0].set_ylabel("time per sample [µs]")
    panels[1, 0].set_ylabel("memory of a call [MB]")
    figure.legend(labels.values(), labels, loc="outside lower center", ncols=3, fontsize=8.5, handlelength=3.4)
    return figure


def _in_short(method: Method) -> Method:
    """The same method in every task: of its setting, what follows a comma."""
    return (*method[:3], method[3].partition(", ")[2])


def over_legs(scaling: pd.DataFrame) -> Figure:
    """Time per sample, and memory of a call, of machines by their number of legs."""
    rows = scaling[~scaling["what"].isin(list(PANELS))]
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    if not len(rows):
        return figure
    names = rows["what"].unique()
    style = styles(("analytic", name) for name in names)
    legs = sorted(rows["legs"].unique())
    panels = (("us_per_sample", "time per sample [µs]"), ("peak_mb", "memory of a call [MB]"))
    for axes, (column, title) in zip(figure.subplots(1, 2), panels, strict=True):
        for name in names:
            part = rows[rows["what"] == name].sort_values("legs")
            label = f"{name.replace('_', ' ')}, {part['backend'].iloc[0]}, {part['batch'].iloc[0]} at a time"
            axes.plot(part["legs"], part[column], **style["analytic", name], label=label)
            proportion = part[column].iloc[0] * part["legs"] / part["legs"].iloc[0]
            label = "in proportion to the legs" if name == names[-1] else None
            axes.plot(part["legs"], proportion, color="0.6", linewidth=0.8, linestyle=":", label=label)
        axes.set(xscale="log", yscale="log", xlabel="legs [1]", ylabel=title)
        axes.set_xticks(legs, [str(n) for n in legs])
        axes.minorticks_off()
    figure.axes[0].legend(loc="upper left", fontsize=8.5)
    figure.suptitle("Number of legs")
    return figure
