"""Speed against error for people: what is best of each method, as a table of the terminal and as files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .files import write_files

if TYPE_CHECKING:
    import pandas as pd

SPEED_ERROR_COLUMNS = [
    "task", "scene", "engine", "route", "backend", "setting", "batch", "us_per_sample", "us_p10", "us_p90",
    "max_rel_error", "ratio_to_fastest",
]  # fmt: skip

METHOD = ["task", "engine", "route", "backend"]

TITLES = {
    "driving_forces": "Driving forces of a motion",
    "all_reactions": "Driving forces and all joint reactions of a motion",
    "forward_step": "Platform accelerations under driving forces",
    "simulate": "One second of motion under driving forces (a sample is a simulated second)",
}

EQUAL = (
    "× fastest: time over that of the fastest row of the task that is at most ten times as wrong and takes at most as"
    " many samples at a time"
)
SPREAD = "p10 - p90"
WIDE = 120
"""Columns of a terminal from which settings and spread have columns of their own."""


def best(table: pd.DataFrame) -> pd.DataFrame:
    """Of each method, of its most accurate settings (within a decade): the fastest, one sample at a time and at all."""
    table = table[table["max_rel_error"].notna()]
    rows = []
    for _, method in table.groupby(METHOD, sort=False):
        equal = method[method["max_rel_error"] <= 10.0 * method["max_rel_error"].min()]
        single = equal[equal["batch"] == 1]
        picks = [*([single["us_per_sample"].idxmin()] if len(single) else []), equal["us_per_sample"].idxmin()]
        rows += dict.fromkeys(picks)
    return table.loc[rows]


def number(x: float) -> str:
    """Three digits, without exponent."""
    return "" if np.isnan(x) else f"{x:,.0f}" if x >= 100 else f"{x:.3g}"


def samples(batch: int) -> str:
    """A batch in few characters."""
    return f"1e{round(np.log10(batch))}" if batch >= 1000 and 10 ** round(np.log10(batch)) == batch else str(batch)


LEFT = ("engine", "method", "setting")
"""Columns of text."""


def columns(task: str) -> tuple[str, ...]:
    """Columns of a task: a simulation takes milliseconds and has no batch."""
    numbers = ("ms",) if task == "simulate" else ("batch", "µs")
    return (*LEFT, *numbers, SPREAD, "error", "× fastest", "× rnea")


def cells(row: pd.Series, baseline: float) -> dict[str, str]:
    """What is shown of a row, by column."""
    median, p10, p90 = row["us_per_sample"], row["us_p10"], row["us_p90"]
    return {
        "engine": str(row["engine"]),
        "method": f"{row['route']} {row['backend']}".strip(),
        "setting": str(row["setting"]),
        "batch": samples(int(row["batch"])),
        "µs": number(median),
        "ms": number(median / 1e3),
        SPREAD: " - ".join(number(us / (1e3 if row["task"] == "simulate" else 1.0)) for us in (p10, p90)),
        "error": f"{row['max_rel_error']:.1e}",
        "× fastest": number(row["ratio_to_fastest"]),
        "× rnea": number(median / baseline),
    }


def yardstick(info: Mapping[str, Any]) -> float:
    """Time [µs] that every other one is compared with; NaN if it was not measured."""
    return info["baseline"]["us_per_sample"] if info["baseline"] else float("nan")


def summary(table: pd.DataFrame) -> list[str]:
    """A sentence for each task: the fastest of the most accurate engines, and the formulas that are as accurate."""
    lines = []
    table = table[table["max_rel_error"].notna() & (table["engine"] != "reference")]
    for task, title in TITLES.items():
        rows = table[table["task"] == task]
        ours, engines = rows[rows["engine"] == "analytic"], rows[rows["engine"] != "analytic"]
        if not len(ours) or not len(engines):
            continue
        theirs = _fastest(engines, 10.0 * engines["max_rel_error"].min())
        fastest = _fastest(ours, 10.0 * theirs["max_rel_error"])
        if fastest is None:
            continue
        ratio = theirs["us_per_sample"] / fastest["us_per_sample"]
        lines.append(
            f"{title}: {_which(fastest)}; of the most accurate engines the fastest is {_which(theirs)},"
            f" {number(ratio)} times as long"
        )
    return lines


def _fastest(rows: pd.DataFrame, error: float) -> Any:
    rows = rows[rows["max_rel_error"] <= error].sort_values("us_per_sample")
    return rows.iloc[0] if len(rows) else None


def _which(row: pd.Series) -> str:
    method = " ".join(str(row[name]) for name in ("engine", "route", "backend") if row[name])
    us = row["us_per_sample"]
    time = f"{number(us)} µs" if us < 1e4 else f"{number(us / 1e3)} ms"
    return f"{method} with {time}, error {row['max_rel_error']:.1e}"


def print_bench(speed_error: pd.DataFrame, split: pd.DataFrame, info: Mapping[str, Any], console: Console) -> None:
    """Print the best settings of each method by task, the split of engines, what failed or is wrong."""
    shown = best(speed_error)
    for task, title in TITLES.items():
        rows = shown[shown["task"] == task]
        if len(rows):
            console.print(title, highlight=False, style="italic", soft_wrap=True)
            console.print(_table(rows, yardstick(info), console.width >= WIDE), crop=False)
            console.print()
    for line in summary(speed_error):
        console.print(line, highlight=False, soft_wrap=True)
    console.print(EQUAL, highlight=False, style="dim")
    if info["baseline"]:
        console.print(
            f"× rnea: time over {yardstick(info):.3g} µs, {info['baseline']['what']}, on the open tree: it answers"
            " nothing",
            highlight=False,
            style="dim",
        )
    if len(split):
        console.print()
        console.print("Time inside the engine's library, 1000 samples at a time", highlight=False, style="italic")
        console.print(_split(split), crop=False)
    _print_verdict(info, len(speed_error), console)


def _table(rows: pd.DataFrame, baseline: float, wide: bool) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0))
    left = LEFT if wide else LEFT[:2]
    right = [name for name in columns(str(rows["task"].iloc[0])) if name not in LEFT and (wide or name != SPREAD)]
    for name in left:
        table.add_column(name, overflow="fold", no_wrap=name == "engine" or (wide and name == "method"))
    for name in right:
        table.add_column(name, justify="right", no_wrap=True)
    before: tuple[str, str] = ("", "")
    for _, row in rows.iterrows():
        cell = cells(row, baseline)
        this = (cell["engine"], cell["method"])
        if not wide:
            cell["method"] += f"\n{cell['setting']}"
        elif this == before:
            cell["method"] = ""
        if this[0] == before[0]:
            cell["engine"] = ""
        before = this
        table.add_row(*(escape(cell[name]) for name in (*left, *right)))
    return table


def _split(split: pd.DataFrame) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0))
    for name in ("engine", "task", "route"):
        table.add_column(name, no_wrap=True)
    for name in ("µs", "in engine", "costliest call", "µs of it"):
        table.add_column(name, justify="left" if name == "costliest call" else "right", no_wrap=True)
    for _, row in split.iterrows():
        numbers = (number(row["us_per_sample"]), f"{row['engine_share']:.0%}")
        table.add_row(
            *(escape(str(row[name])) for name in ("engine", "task", "route")), *numbers, escape(str(row["call"])),
            number(row["call_us"]),
        )  # fmt: skip
    return table


def _print_verdict(info: Mapping[str, Any], rows: int, console: Console) -> None:
    for title, style, listed, tells in (
        (
            "WRONG",
            "bold red",
            info["wrong"],
            lambda r: f"error {r['max_rel_error']:.1e}, {r['over_tolerance']:.1e} times what is allowed",
        ),
        ("ERROR", "yellow", info["failed"], lambda r: r["reason"]),
    ):
        for row in listed:
            which = " ".join(str(row[name]) for name in ("engine", "route", "backend", "task", "setting") if row[name])
            text = escape(f"{which}, batch {row['batch']}: {tells(row)}")
            console.print(f"[{style}]{title}[/] {text}", highlight=False, soft_wrap=True)
    good = not info["wrong"] and not info["failed"]
    text = f"{rows} settings timed" if good else f"{len(info['wrong'])} wrong, {len(info['failed'])} failed"
    console.print(f"[{'bold green' if good else 'bold red'}]{text}[/] in {info['seconds']:.0f} s", highlight=False)


def write_bench(
    folder: Path, speed_error: pd.DataFrame, scaling: pd.DataFrame, split: pd.DataFrame, info: Mapping[str, Any]
) -> None:
    """speed_error.csv, scaling.csv, split.csv, plots as SVG and PNG, report.html, run.json. Raises OutputError."""
    from .page import Shown, bench_page  # with matplotlib: a second, which no other command need wait for
    from .plots import draw

    baseline = yardstick(info)
    plots = draw(speed_error, scaling, baseline)
    shown = []
    for task, title in TITLES.items():
        rows = best(speed_error[speed_error["task"] == task])
        shown.append(Shown(title, columns(task), [cells(row, baseline) for _, row in rows.iterrows()]))
    files: dict[str, str | bytes] = {
        "speed_error.csv": speed_error[SPEED_ERROR_COLUMNS].to_csv(index=False),
        "scaling.csv": scaling.to_csv(index=False),
        "split.csv": split.to_csv(index=False),
        "report.html": bench_page(
            shown, speed_error[SPEED_ERROR_COLUMNS], split, plots, info, EQUAL, summary(speed_error)
        ),
        "run.json": json.dumps(info, indent=2) + "\n",
    }
    for name, plot in plots.items():
        files |= {f"{name}.svg": plot.svg, f"{name}.png": plot.png}
    write_files(folder, files)
