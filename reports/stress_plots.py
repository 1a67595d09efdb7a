"""Plots of hard cases: error over the parameter of each case. Readable in black and white, axes with units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import groupby
from math import ceil, floor, log10, nan
from textwrap import fill
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from .drawing import STYLE, Plot, files, styles, words
from .stress import PROBLEMS, methods
from .stress_matrix import matrix

BOTTOM, TOP = 1e-17, 1e3
"""Errors that are drawn: a perfect answer has none, and beyond the top no digit and no power of ten is left."""

NEAR = 100.0
"""An answer within so many times the input sensitivity is accurate."""

HALF = 0.2
"""Half the width of what stands alone beside the axis' break, in decades."""

RING, STRIP, DARK, LIGHT, HATCH = "#b00020", "#eef3f8", "0.78", "0.92", "0.75"
Styles = Mapping[tuple[str, ...], Mapping[str, Any]]


def draw(found: pd.DataFrame) -> dict[str, Plot]:
    """All plots by name: ``stress_CASE``, and the summary ``outcomes``. ``found``: one row per method and point."""
    with mpl.rc_context(STYLE):
        style = styles(methods(found))
        figures = {f"stress_{case}": error_curves(rows, style) for case, rows in found.groupby("case", sort=False)}
        figures["outcomes"] = matrix(found)
        return {name: files(name, figure) for name, figure in figures.items() if figure.axes}


class Across:
    """Where values of a parameter stand: by powers of ten, zero left of them behind a break; a short range evenly.

    ``zero``: place of zero, NaN if it is not among the values or has no break.
    """

    def __init__(self, values: pd.Series) -> None:
        found = np.unique(values.to_numpy(dtype=float))
        positive = found[found > 0.0].tolist()
        self.zero = nan
        self.even = found[0] < 0.0 or not positive or positive[-1] < 30.0 * positive[0]
        if not self.even:
            self.first, last = log10(positive[0]), log10(positive[-1])
            step = max(1, round((last - self.first) / 6.0))
            self.ticks = [float(k) for k in range(floor(last + 1e-9), ceil(self.first - 1e-9) - 1, -step)]
            self.labels = [f"$10^{{{k:.0f}}}$" for k in self.ticks]
            if found[0] == 0.0:
                self.zero = self.first - max(1.0, 0.12 * (last - self.first))
                self.ticks.append(self.zero)
                self.labels.append("0")
        self.places = self(values)

    def __call__(self, values: pd.Series) -> np.ndarray:
        """Places on the axis."""
        x = values.to_numpy(dtype=float)
        return x if self.even else np.log10(x, out=np.full(len(x), self.zero), where=x > 0.0)

    def finish(self, axes: Axes) -> None:
        """Ticks, limits, and the break before zero."""
        margin = 0.04 * max(float(np.ptp(self.places)), 1.0)
        axes.set_xlim(float(self.places.min()) - margin, float(self.places.max()) + margin)
        if not self.even:
            axes.set_xticks(self.ticks, self.labels)
        if np.isfinite(self.zero):
            axes.text(
                (self.zero + self.first) / 2.0, 0.0, "//", transform=axes.get_xaxis_transform(), ha="center",
                va="center", fontsize=9, bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8},
            )  # fmt: skip


def error_curves(rows: pd.DataFrame, style: Styles) -> Figure:
    """Error over the parameter, a panel for each problem, a curve for each method, over the input sensitivity.

    Full marks are accurate, hollow ones degraded, ringed ones silent; what has no error is in the strip on top, each
    method in a line of its own: refused points, and ringed the answers that nothing can be compared with.
    """
    problems = list(dict.fromkeys(rows["problem"]))
    shown = methods(rows)
    lost = rows[rows["max_rel_error"].isna()]
    lanes = {p: [m for m in shown if m in methods(lost[lost["problem"] == p])] for p in problems}
    most = max(1, *map(len, lanes.values()))
    strip = 0.17 * most + 0.1
    figure = Figure(figsize=(4.9 * len(problems) + 2.9, 4.6 + strip), layout="constrained")
    grid = figure.subplots(2, len(problems), sharex="col", sharey="row", squeeze=False, height_ratios=(strip, 4.2))
    across = Across(rows["value"])
    for (top, axes), problem in zip(grid.T, problems, strict=True):
        part = rows[rows["problem"] == problem].sort_values("value", kind="stable")
        _shade(axes, part, across)
        for method in methods(part):
            _curve(axes, _of(part, method), style[method], across)
        for k, method in enumerate(lanes[problem]):
            line = _of(part[part["max_rel_error"].isna()], method)
            _marks(top, across(line["value"]), np.full(len(line), float(-k)), line["outcome"], style[method])
        top.set(ylim=(0.6 - most, 0.6), yticks=[], facecolor=STRIP, title=words(PROBLEMS.get(problem, problem)))
        top.spines["bottom"].set_visible(False)
        top.tick_params(bottom=False, labelbottom=False)
        top.grid(visible=False)
        axes.set(yscale="log", xlabel=words(rows["parameter"].iloc[0]))
        across.finish(axes)
    grid[0, 0].set_ylabel("refused", rotation=0, ha="right", va="center", fontsize=9)
    _heights(grid[1, 0], rows)
    grid[1, 0].set_ylabel("largest error over scale [1]")
    title = fill(str(rows["title"].iloc[0]), 52 * len(problems))
    figure.suptitle(words(title), x=0.02, ha="left", fontsize=11)  # the legend stands on the right
    named = [Line2D([], [], **style[method], label=words(" ".join(method))) for method in shown]
    figure.legend(
        handles=[*named, *_meanings(rows)], loc="outside right upper", fontsize=8.5, handlelength=3.4, labelspacing=0.7
    )
    return figure


def _of(rows: pd.DataFrame, method: tuple[str, str]) -> pd.DataFrame:
    return rows[(rows["engine"] == method[0]) & (rows["route"] == method[1])]


def _heights(axes: Axes, rows: pd.DataFrame) -> None:
    """Limits from what is there, powers of ten between them; what is beyond the top stands on it, and it says so."""
    largest = float(np.nanmax([*rows["max_rel_error"], *rows["input_sensitivity"], 1e-13]))
    top = min(ceil(log10(min(largest, TOP))) + 1, round(log10(TOP)))
    ticks = list(range(-16, top + 1, 2 if top < -6 else 4))
    if largest > TOP:
        ticks = [*(k for k in ticks if k < top), top]
    axes.set_ylim(BOTTOM, 2.0 * 10.0**top)
    labels = [f"{'≥ ' if k == top and largest > TOP else ''}$10^{{{k}}}$" for k in ticks]
    axes.set_yticks([10.0**k for k in ticks], labels)
    axes.minorticks_off()


def _curve(axes: Axes, rows: pd.DataFrame, style: Mapping[str, Any], across: Across) -> None:
    """Marks by outcome; a line joins neighbours, but nothing across a refused point or the break before zero."""
    x, y = across(rows["value"]), rows["max_rel_error"].clip(BOTTOM, TOP).to_numpy(dtype=float)
    line: dict[str, Any] = {key: style[key] for key in ("color", "linestyle", "linewidth")}
    axes.plot(x, np.where(x == across.zero, nan, y), **line)
    there = np.isfinite(y)
    _marks(axes, x[there], y[there], rows["outcome"][there], style)


def _marks(axes: Axes, x: np.ndarray, y: np.ndarray, outcomes: pd.Series, style: Mapping[str, Any]) -> None:
    mark: dict[str, Any] = {key: style[key] for key in ("color", "marker", "markersize")} | {"linestyle": ""}
    for outcome in dict.fromkeys(outcomes):
        which = (outcomes == outcome).to_numpy()
        face = "white" if outcome == "degraded" else style["color"]
        axes.plot(x[which], y[which], **mark, markerfacecolor=face, zorder=3, clip_on=False, gid=str(outcome))
        if outcome == "silent":
            axes.plot(x[which], y[which], **_ring(), zorder=4, clip_on=False)


def _ring() -> dict[str, Any]:
    return {
        "linestyle": "", "marker": "o", "markersize": 12, "markerfacecolor": "none", "markeredgecolor": RING,
        "markeredgewidth": 1.6, "gid": "ring",
    }  # fmt: skip


def _shade(axes: Axes, rows: pd.DataFrame, across: Across) -> None:
    """The input sensitivity, and a hundred times it, half a step beyond where it is known; elsewhere hatched."""
    known = rows.groupby("value")["input_sensitivity"].max().clip(BOTTOM, TOP)
    x, s = across(known.index.to_series()), known.to_numpy(dtype=float)
    for run in _runs(x == across.zero, np.isfinite(s)):
        left, right = (x[run][0] - HALF, x[run][-1] + HALF)
        if run.start > 0 and x[run.start - 1] != across.zero:
            left = (x[run.start - 1] + x[run.start]) / 2.0
        if run.stop < len(x) and x[run.start] != across.zero:
            right = (x[run.stop - 1] + x[run.stop]) / 2.0
        if np.isfinite(s[run.start]):
            ends, heights = np.array([left, *x[run], right]), np.array([s[run][0], *s[run], s[run][-1]])
            axes.fill_between(ends, BOTTOM, heights, color=DARK, linewidth=0, zorder=0.5, gid="sensitivity")
            axes.fill_between(ends, heights, NEAR * heights, color=LIGHT, linewidth=0, zorder=0.5, gid="near")
        else:
            axes.axvspan(
                float(left), float(right), facecolor="none", edgecolor=HATCH, hatch="///", linewidth=0, gid="no truth"
            )


def _runs(*marks: np.ndarray) -> Iterator[slice]:
    """Stretches of neighbours that have the same marks."""
    at = 0
    for _, part in groupby(zip(*(m.tolist() for m in marks), strict=True)):
        stop = at + len(list(part))
        yield slice(at, stop)
        at = stop


def _meanings(rows: pd.DataFrame) -> list[Line2D | Patch]:
    """Legend of what stands for what, as far as it is there."""
    mark: dict[str, Any] = {"color": "0.25", "marker": "o", "markersize": 5.5, "linestyle": ""}
    marks = {
        "accurate": Line2D([], [], **mark, label="full: accurate"),
        "degraded": Line2D([], [], **mark, markerfacecolor="white", label="hollow: degraded"),
        "silent": Line2D([], [], **_ring(), label="ringed: silent"),
        "refused": Patch(facecolor=STRIP, edgecolor="0.6", linewidth=0.5, label="in the strip: refused"),
    }
    dark, light = Patch(color=DARK, label="up to the input sensitivity"), Patch(color=LIGHT, label="up to 100 times it")
    unknown = Patch(facecolor="none", edgecolor=HATCH, hatch="///", linewidth=0, label="no certified truth")
    there = [handle for name, handle in marks.items() if (rows["outcome"] == name).any()]
    return [*there, dark, light, *([unknown] if rows["input_sensitivity"].isna().any() else [])]
