"""Hard cases for people: what became of every method, as a table of the terminal and as files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .files import write_files

if TYPE_CHECKING:
    import pandas as pd

STRESS_COLUMNS = [
    "case", "parameter", "value", "engine", "route", "quantity", "max_rel_error", "input_sensitivity", "condition",
    "outcome",
]  # fmt: skip

OUTCOMES = {
    "accurate": "within 100 times what half-ulp changes of the inputs make of the exact answer",
    "degraded": "beyond that, but within what the route states there",
    "refused": "a clear error and no number",
    "silent": "beyond both, and nothing says so: a defect",
}
"""From the best to the worst, and what they mean."""

PROBLEMS = {
    "inverse": "Forces and reactions of a motion",
    "forward": "Accelerations under given forces",
    "in time": "Motion under given forces",
}

METHOD = ["engine", "route", "problem"]
REASON_COLUMNS = ["case", "value", *METHOD, "outcome", "reason"]
STYLE = {"accurate": "green", "degraded": "yellow", "refused": "cyan", "silent": "bold red"}


def points(table: pd.DataFrame) -> pd.DataFrame:
    """One row per method and point: its worst outcome with a reason, the largest error and the largest sensitivity."""
    key = ["case", "value", *METHOD]
    rank = table["outcome"].map({name: k for k, name in enumerate(OUTCOMES)})
    rows = table.assign(rank=rank).sort_values(["rank", "max_rel_error"], ascending=False, kind="stable")
    worst = rows.drop_duplicates(key).sort_index()[[*key, "family", "title", "parameter", "outcome", "reason"]]
    largest = table.groupby(key, sort=False)[["max_rel_error", "input_sensitivity"]].max().reset_index()
    known = largest.groupby(["case", "value", "problem"])["input_sensitivity"].transform("max")
    largest["input_sensitivity"] = largest["input_sensitivity"].fillna(known)  # also of what was refused
    return largest.merge(worst, on=key, validate="one_to_one")


def methods(found: pd.DataFrame) -> list[tuple[str, str]]:
    """Engines in their order, and the routes of each in theirs."""
    pairs = list(dict.fromkeys(zip(found["engine"].astype(str), found["route"].astype(str), strict=True)))
    return [pair for engine in dict.fromkeys(e for e, _ in pairs) for pair in pairs if pair[0] == engine]


def counts(found: pd.DataFrame) -> pd.DataFrame:
    """Points of each method by outcome."""
    ticks = found.assign(points=1, **{name: found["outcome"] == name for name in OUTCOMES})
    sums = ticks.groupby(METHOD, sort=False)[["points", *OUTCOMES]].sum().astype(int).reset_index()
    order = {name: k for k, name in enumerate(PROBLEMS)}
    return sums.sort_values("problem", key=lambda names: names.map(order), kind="stable", ignore_index=True)


def ours(found: pd.DataFrame) -> pd.Series:
    """Which rows are of the formulas or of hard loops, not of engines' own solvers: none of them may be silent."""
    return ~found["route"].str.startswith("native")


class Group(NamedTuple):
    """Points of one method in one case that ended alike, and the reason of the worst."""

    method: str
    problem: str
    case: str
    where: str
    points: int
    error: str
    reason: str


def groups(found: pd.DataFrame, outcome: str) -> list[Group]:
    """What ended so, a line for each method and case."""
    made = []
    for key, rows in found[found["outcome"] == outcome].groupby(["case", *METHOD], sort=False):
        case, engine, route, problem = map(str, key)
        worst = rows.sort_values("max_rel_error", na_position="first", kind="stable").iloc[-1]
        error = "" if np.isnan(worst["max_rel_error"]) else f"{worst['max_rel_error']:.1e}"
        ends = [f"{value:g}" for value in dict.fromkeys(rows["value"].iloc[[0, -1]])]
        where = f"{' … '.join(ends)} ({rows['parameter'].iloc[0]})"
        made.append(Group(f"{engine} {route}", problem, case, where, len(rows), error, str(worst["reason"])))
    return made


def verdict(found: pd.DataFrame, info: Mapping[str, Any]) -> tuple[bool, str]:
    """Whether all is well, and the sentence that says so."""
    silent = found["outcome"] == "silent"
    mine = int((silent & ours(found)).sum())
    theirs = int(silent.sum()) - mine
    if mine:
        text = f"silent answers of ours: {mine}"
    elif info["failed"]:
        text = f"nothing of ours is silent, but {', '.join(info['failed'])} failed to run"
    else:
        text = "nothing of ours is silent"
    lost = int((ours(found) & found["reason"].fillna("").str.startswith("no digits")).sum())
    more = {"degraded": f" ({lost} of ours without a digit, as their route states)"} if lost else {}
    sums = [f"{(found['outcome'] == name).sum()} {name}{more.get(name, '')}" for name in OUTCOMES if name != "silent"]
    sums.append(f"{theirs} silent of engines' own solvers")
    return not mine and not info["failed"], f"{text}: {', '.join(sums)}"


def print_stress(table: pd.DataFrame, info: Mapping[str, Any], console: Console) -> None:
    """Print the outcomes of each method, every silent group with its reason, what failed to run, and the verdict."""
    found = points(table)
    for problem, rows in counts(found).groupby("problem", sort=False):
        console.print(PROBLEMS.get(str(problem), str(problem)), highlight=False, style="italic", soft_wrap=True)
        console.print(_table(rows), crop=False)
        console.print()
    for name, meaning in OUTCOMES.items():
        console.print(f"{name}: {meaning}", highlight=False, style="dim")
    for group in groups(found, "silent"):
        error = f"error up to {group.error}: " if group.error else ""
        text = f"{group.method}, {group.problem}: {group.case} at {group.where}: {error}{group.reason}"
        console.print(f"[bold red]SILENT[/] {escape(text)}", highlight=False, soft_wrap=True)
    for engine, reason in info["failed"].items():
        console.print(f"[yellow]ERROR[/] {escape(f'{engine}: {reason}')}", highlight=False, soft_wrap=True)
    good, text = verdict(found, info)
    style = "bold green" if good else "bold red"
    console.print(f"[{style}]{escape(text)}[/], in {info['seconds']:.0f} s", highlight=False, soft_wrap=True)


def _table(rows: pd.DataFrame) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0))
    for name in ("engine", "route"):
        table.add_column(name, min_width=11, overflow="fold")
    for name in ("points", *OUTCOMES):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows.to_dict("records"):
        cells = [f"[{STYLE[name]}]{row[name]}[/]" if row[name] else "" for name in OUTCOMES]
        table.add_row(escape(str(row["engine"])), escape(str(row["route"])), str(row["points"]), *cells)
    return table


def write_stress(folder: Path, table: pd.DataFrame, info: Mapping[str, Any]) -> None:
    """stress.csv, reasons.csv, outcomes.csv, plots as SVG and PNG, report.html, run.json. Raises OutputError."""
    from .page import stress_page  # with matplotlib: a second, which no other command need wait for
    from .stress_plots import draw

    found = points(table)
    plots = draw(found)
    files: dict[str, str | bytes] = {
        "stress.csv": table[STRESS_COLUMNS].to_csv(index=False),
        "reasons.csv": found.loc[found["outcome"] != "accurate", REASON_COLUMNS].to_csv(index=False),
        "outcomes.csv": counts(found).to_csv(index=False),
        "report.html": stress_page(found, plots, info),
        "run.json": json.dumps(info, indent=2) + "\n",
    }
    for name, plot in plots.items():
        files |= {f"{name}.svg": plot.svg, f"{name}.png": plot.png}
    write_files(folder, files)
