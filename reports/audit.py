"""The table of the audit for people."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

if TYPE_CHECKING:
    import pandas as pd

_STYLE = {"pass": "green", "fail": "bold red"}
_TITLES = {
    "equation": "Equations: miss of certified truth, over the largest force (times the longest leg)",
    "misprint": "Misprints that change a number: miss of the correct and of the printed reading",
    "control": "Controls, mistakes made on purpose: miss of the correct and of the wrong reading",
    "text": "Misprints that change no number",
}

_NOUNS = {
    "equation": "equations",
    "misprint": "misprints with a number",
    "control": "controls",
    "text": "misprints of words",
}
WIDE = 120
"""Columns of a terminal from which the table says what each row states."""


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.1e}"


def _place(row: pd.Series) -> str:
    return escape(str(row["row"])) + (" *" if row["probably_scan"] else "")


def _measured(rows: pd.DataFrame, wide: bool) -> Table:
    """Place, function, residuals and verdict; a second function has a line of its own. Wide: what it states, too."""
    two = rows["printed_residual"].notna().any()
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    table.add_column("place" if two else "equation", max_width=22, overflow="fold")
    if wide:
        table.add_column("states", overflow="fold")
    table.add_column("where", overflow="fold")
    for name in ("residual", "printed") if two else ("residual",):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    for _, row in rows.iterrows():
        numbers = [_number(row["residual"]), *([_number(row["printed_residual"])] if two else [])]
        verdict = str(row["verdict"])
        where = escape(str(row["where"]).replace("stewart.", "").replace(" ", "\n"))
        states = [escape(str(row["states"]))] if wide else []
        table.add_row(_place(row), *states, where, *numbers, f"[{_STYLE[verdict]}]{verdict}[/]")
    return table


def _text(rows: pd.DataFrame) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for name in ("place", "printed", "correct"):
        table.add_column(name, overflow="fold")
    for _, row in rows.iterrows():
        table.add_row(_place(row), escape(str(row["printed"])), escape(str(row["correct"])))
    return table


def print_audit(audit: pd.DataFrame, console: Console) -> None:
    """Print the table by kind, then what failed, and the verdict."""
    for kind, title in _TITLES.items():
        rows = audit[audit["kind"] == kind]
        if len(rows):
            console.print(title, highlight=False, style="italic", soft_wrap=True)
            console.print(_text(rows) if kind == "text" else _measured(rows, console.width >= WIDE))
            console.print()
    console.print("* probably damage of the scanned copy that was read, not of the paper", highlight=False)
    failed = audit[audit["verdict"] == "fail"]
    for _, row in failed.iterrows():
        text = f"{row['row']}, {row['states']}: {row['reason']}"
        console.print(f"[bold red]FAIL[/] {escape(text)}", highlight=False, soft_wrap=True)
    counts = audit["kind"].value_counts()
    summary = ", ".join(f"{counts[kind]} {noun}" for kind, noun in _NOUNS.items() if kind in counts)
    verdict = f"{len(failed)} of the rows fail" if len(failed) else "every equation holds and every misprint shows"
    console.print(f"[{'bold red' if len(failed) else 'bold green'}]{verdict}[/]: {summary}", highlight=False)
