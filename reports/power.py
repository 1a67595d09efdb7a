"""The table of detection power: for people, as files, as a plot."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .files import write_files


def _method(rows: pd.DataFrame) -> pd.Series:
    return rows["engine"] + " " + rows["route"]


def groups(rows: pd.DataFrame) -> pd.DataFrame:
    """The worst of the smallest faults, groups down, engines and routes across; NaN where all are blind."""
    found = rows.assign(method=_method(rows))
    columns = list(dict.fromkeys(found["method"]))
    table = found.pivot_table(index="group", columns="method", values="smallest", aggfunc="max", sort=False)
    return table.reindex(index=list(dict.fromkeys(found["group"])), columns=columns)


def blind(rows: pd.DataFrame) -> dict[str, list[str]]:
    """Faults that nothing sees, by the engine, if it is one of its numbers, and why."""
    found: dict[str, list[str]] = {}
    for row in rows[rows["verdict"] == "blind"].to_dict("records"):
        number = row["kind"] == "parameter"
        why = f"{row['engine']} {row['route']}: {row['reason']}" if number else str(row["reason"])
        name = str(row["fault"]) if number else f"{row['where'].split()[0]} {row['fault']}"
        found.setdefault(why, []).append(name)
    return found


def unseen(rows: pd.DataFrame) -> pd.DataFrame:
    """Terms that no engine and no command sees anywhere, and signs of those that are seen otherwise."""
    keys = ["where", "fault"]
    seen = rows.loc[rows["verdict"] == "detected", ["kind", *keys]].drop_duplicates().assign(seen=True)
    left = rows.sort_values("command", key=lambda c: c != "run", kind="stable").merge(seen, "left", ["kind", *keys])
    left = left[left["seen"].isna()].drop_duplicates(["kind", *keys])
    terms = left[left["kind"] == "term"]
    signs = left[left["kind"] == "sign"].merge(terms[keys], "left", keys, indicator=True)
    return pd.concat([terms, signs[signs["_merge"] == "left_only"]])


def _print_blind(rows: pd.DataFrame, console: Console) -> None:
    for why, names in blind(rows).items():
        text = f"[yellow]blind[/] {escape(why)}: {escape('; '.join(names))}"
        console.print(text, highlight=False, soft_wrap=True, emoji=False)
    console.print()


def _table(*columns: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0))
    for k, name in enumerate(columns):
        table.add_column(name, justify="right" if k else "left", overflow="fold")
    return table


def _print_parameters(rows: pd.DataFrame, console: Console) -> None:
    console.print("Numbers: the worst of the smallest relative faults detected, by group", style="italic")
    worst = groups(rows)
    table = _table("group", *(str(c).replace(" ", "\n") for c in worst.columns))
    hidden = rows.assign(method=_method(rows))[rows["verdict"] != "detected"].groupby(["group", "method"]).size()
    for group, cells in worst.iterrows():
        texts = []
        for method, x in cells.items():
            count = int(hidden.get((group, method), 0))
            texts.append(("" if x != x else f"{x:.0e}") + (f" [yellow]{count} not[/]" if count else ""))
        table.add_row(str(group), *texts)
    console.print(table, crop=False)
    _print_blind(rows, console)


def _print_terms(table: pd.DataFrame, console: Console) -> None:
    console.print("Terms and signs of the formulas", style="italic")
    rows = table[table["kind"].isin(["term", "sign"])]
    shown = _table("command", "scene", "engine", "route", "terms", "detected", "worst", "signs", "detected")
    keys = ["command", "scene", "engine", "route"]
    for key, part in rows.groupby(keys, sort=False):
        terms, signs = part[part["kind"] == "term"], part[part["kind"] == "sign"]
        counts = [(len(x), int((x["verdict"] == "detected").sum())) for x in (terms, signs)]
        worst = terms["smallest"].max()
        texts = [str(counts[0][0]), str(counts[0][1]), "" if worst != worst else f"{worst:.0e}", *map(str, counts[1])]
        shown.add_row(*(escape(str(k) or "-") for k in key), *texts)
    console.print(shown, crop=False)
    _print_blind(unseen(rows), console)


def _print_mistakes(rows: pd.DataFrame, console: Console) -> None:
    console.print("Mistakes of public codes: error over tolerance where caught, by scene", style="italic")
    scenes = list(dict.fromkeys(rows["scene"]))
    shown = _table("mistake", *scenes)
    for (code, name), part in rows.groupby(["group", "fault"], sort=False):
        cells = []
        for scene in scenes:
            at = part[part["scene"] == scene]
            seen = at[at["verdict"] == "detected"].sort_values("error_over_tolerance", ascending=False)
            cells.append(f"{seen['error_over_tolerance'].iloc[0]:.0e}" if len(seen) else "[dim]-[/]")
        shown.add_row(f"{escape(str(name))} [dim]{escape(str(code).split(',')[0])}[/]", *cells)
    console.print(shown, crop=False)
    console.print()


def print_power(table: pd.DataFrame, info: Mapping[str, Any], console: Console) -> None:
    """Print numbers by group, terms by command, mistakes by scene, what is blind, and the verdict."""
    _print_parameters(table[table["kind"] == "parameter"], console)
    _print_terms(table, console)
    _print_mistakes(table[table["kind"] == "mistake"], console)
    for text in info["disagree"]:
        console.print(f"[bold red]FAIL[/] {escape(text)} fails without any fault", highlight=False, soft_wrap=True)
    for engine, reason in info["failed"].items():
        console.print(f"[yellow]ERROR[/] {escape(f'{engine}: {reason}')}", highlight=False, soft_wrap=True)
    missed = info["uncaught"]
    text = f"not caught: {', '.join(missed)}" if missed else "every mistake is caught"
    counts = table.groupby("verdict").size()
    sums = ", ".join(f"{counts[v]} {v}" for v in ("detected", "blind", "not run") if v in counts)
    style = "bold red" if missed or info["disagree"] else "bold green"
    console.print(f"[{style}]{escape(text)}[/]: {sums}, in {info['seconds']:.0f} s", highlight=False, soft_wrap=True)


def write_power(folder: Path, table: pd.DataFrame, info: Mapping[str, Any]) -> None:
    """power.csv, power.svg, power.png and run.json. Raises OutputError."""
    from .power_plot import draw  # with matplotlib: a second, which no other command need wait for

    plot = draw(table[table["kind"] == "parameter"])
    files: dict[str, str | bytes] = {
        "power.csv": table.to_csv(index=False),
        "power.svg": plot.svg,
        "power.png": plot.png,
        "run.json": json.dumps(info, indent=2) + "\n",
    }
    write_files(folder, files)
