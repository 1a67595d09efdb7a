"""The worst outcome of every method in every case, as one figure."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from .drawing import words
from .stress import OUTCOMES, PROBLEMS, methods

SHADES = {"accurate": "#f2f2f2", "degraded": "#f0d889", "refused": "#7fa8c9", "silent": "#8f0f1f"}


def matrix(found: pd.DataFrame) -> Figure:
    """The worst outcome of every method in every case: a letter and a shade.

    A refusal where nothing is certain counts only if there is nothing else.
    """
    cases = found.drop_duplicates("case")[["case", "family", "title"]].to_dict("records")
    columns = [
        (problem, *method)
        for problem in sorted(set(found["problem"]), key=list(PROBLEMS).index)
        for method in methods(found[found["problem"] == problem])
    ]
    figure = Figure(figsize=(1.9 + 0.3 * len(columns) + 3.6, 1.7 + 0.215 * len(cases)), layout="constrained")
    if not cases:
        return figure
    axes = figure.subplots()
    names = list(OUTCOMES)
    excused = (found["outcome"] == "refused") & found["input_sensitivity"].isna()
    rank = found["outcome"].map(names.index).mask(excused, -1)
    worst = rank.groupby([found["case"], found["problem"], found["engine"], found["route"]]).max().to_dict()
    for row, case in enumerate(cases):
        for column, method in enumerate(columns):
            outcome = worst.get((case["case"], *method))
            if outcome is not None:
                _cell(axes, column, row, "refused" if outcome < 0 else names[outcome])
    axes.set(xlim=(-0.5, len(columns) - 0.5), ylim=(len(cases) - 0.5, -0.5))
    axes.set_yticks(range(len(cases)), [words(case["case"]) for case in cases], fontsize=8)
    axes.set_xticks(range(len(columns)), [words(f"{e} {r}") for _, e, r in columns], rotation=90, fontsize=8)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    for row, case in enumerate(cases):
        axes.annotate(
            words(case["title"]), (1.0, row), xycoords=("axes fraction", "data"), xytext=(6, 0),
            textcoords="offset points", va="center", fontsize=7.5, color="0.25",
        )  # fmt: skip
    for k in range(1, len(cases)):
        if cases[k]["family"] != cases[k - 1]["family"]:
            axes.axhline(k - 0.5, color="0.2", linewidth=0.8)
    for k in range(1, len(columns)):
        if columns[k][0] != columns[k - 1][0]:
            axes.axvline(k - 0.5, color="0.2", linewidth=1.6)
    _below(axes, columns, len(cases))
    shades = {"edgecolor": "0.5", "linewidth": 0.5}
    handles = [Patch(facecolor=SHADES[name], label=f"{name[0].upper()}: {name}", **shades) for name in OUTCOMES]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=8)
    return figure


def _cell(axes: Axes, column: int, row: int, outcome: str) -> None:
    shade = SHADES[outcome]
    axes.add_patch(Rectangle((column - 0.5, row - 0.5), 1.0, 1.0, facecolor=shade, edgecolor="white", linewidth=1.2))
    axes.text(
        column, row, outcome[0].upper(), ha="center", va="center", fontsize=8, gid="outcome",
        color="white" if outcome == "silent" else "black", fontweight="normal" if outcome == "accurate" else "bold",
    )  # fmt: skip


def _below(axes: Axes, columns: list[tuple[str, str, str]], rows: int) -> None:
    """Names of the problems under their columns."""
    for problem in dict.fromkeys(column[0] for column in columns):
        which = [k for k, column in enumerate(columns) if column[0] == problem]
        axes.annotate(
            words(problem), (float(np.mean(which)), rows - 0.5), xytext=(0, -5), textcoords="offset points",
            ha="center", va="top", fontsize=8.5, style="italic", annotation_clip=False,
        )  # fmt: skip
