"""The verdict table for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.table import Table

if TYPE_CHECKING:
    import pandas as pd

STYLE = {"pass": "green", "fail": "bold red", "error": "yellow", "unsupported": "dim"}


_FORWARD = "a"
"""A quantity of the routes that are handed the driving forces, and of no other."""


def _cell(row: pd.Series) -> str:
    text = f"{row['max_rel']:.1e}" if row["verdict"] in ("pass", "fail") else row["verdict"]
    if str(row["tolerance_name"]).startswith("law_of_") and row["verdict"] == "pass":
        text += f" ≤ {row['tolerance']:.0e}"
    if row["verdict"] == "fail":
        text += " FAIL"
    return f"[{STYLE[row['verdict']]}]{text}[/]"


def _table(agreement: pd.DataFrame, engines: pd.DataFrame) -> Table:
    """Quantities down, some of the engines and routes across."""
    table = Table()
    table.add_column("quantity", no_wrap=True)
    table.add_column("scale", justify="right", no_wrap=True)
    shown = agreement.merge(engines[["engine", "route"]])
    for _, e in engines.iterrows():
        name = e["engine"] + (f" {e['engine_version']}" if e["engine_version"] else "")
        table.add_column(f"{name}\n[dim]{e['route'] or '-'}[/]", justify="right", no_wrap=True)
    for quantity, rows in shown.groupby("quantity", sort=False):
        cells = {(row["engine"], row["route"]): _cell(row) for _, row in rows.iterrows()}
        scale = rows["scale"].dropna()
        table.add_row(
            str(quantity),
            f"{scale.iloc[0]:.4g} {rows['unit'].iloc[0]}" if len(scale) else "-",
            *(cells.get((e["engine"], e["route"]), "") for _, e in engines.iterrows()),
        )
    return table


def _print_tables(agreement: pd.DataFrame, engines: pd.DataFrame, console: Console) -> None:
    """One table, or as many as a narrow terminal needs: numbers are never cut."""
    table = _table(agreement, engines)
    table.width = console.measure(table, options=console.options.update(max_width=1000)).maximum
    if len(engines) > 1 and table.width > console.width:
        half = (len(engines) + 1) // 2
        _print_tables(agreement, engines[:half], console)
        _print_tables(agreement, engines[half:], console)
    else:
        console.print(table, crop=False)


def print_verdict(agreement: pd.DataFrame, console: Console) -> None:
    """Print max_rel of every quantity and engine, then what failed, where, and the verdict.

    `agreement` has the published columns and `where`, `share`, `reason`. The certified column gives proven radii.
    """
    routes = agreement.drop_duplicates(["engine", "route"])[["engine", "route", "engine_version"]]
    handed = agreement[agreement["quantity"] == _FORWARD].set_index(["engine", "route"]).index
    routes["forward"] = routes.set_index(["engine", "route"]).index.isin(handed)
    for title, which in (
        ("largest error over scale (certified: proven radius over scale)", ~routes["forward"]),
        ("engines' own solvers under certified driving forces: largest error ≤ allowed, over scale", routes["forward"]),
    ):
        if which.any():
            console.print(title, highlight=False, style="italic")
            _print_tables(agreement, routes[which], console)
    for _, row in agreement[agreement["verdict"] == "fail"].iterrows():
        console.print(
            f"[bold red]FAIL[/] {row['engine']} {row['route']} {row['quantity']}:"
            f" {row['share'] * row['tolerance']:.2e} of {row['scale']:.4g} {row['unit']} at {row['where']}, allowed"
            f" {row['tolerance']:.1e} there ({row['tolerance_name']})",
            highlight=False,
            soft_wrap=True,
        )
    print_reasons(agreement, console)


def print_reasons(rows: pd.DataFrame, console: Console) -> None:
    """Print why rows are in error or unsupported, once for each engine and route, and the verdict."""
    for verdict, style in (("error", "yellow"), ("unsupported", "dim")):
        for name, group in rows[rows["verdict"] == verdict].groupby(["engine", "route"], sort=False):
            what = f"{verdict.upper()}[/] {' '.join(map(str, name)).strip()}"
            console.print(f"[{style}]{what}: {escape(group['reason'].iloc[0])}", highlight=False, soft_wrap=True)
    counts = rows["verdict"].value_counts().to_dict()
    summary = ", ".join(f"{counts[v]} {v}" for v in STYLE if v in counts)
    ok = set(counts) <= {"pass", "unsupported"}
    console.print(
        f"[{'bold green' if ok else 'bold red'}]{'all agree' if ok else 'not all agree'}[/]: {summary}", highlight=False
    )
