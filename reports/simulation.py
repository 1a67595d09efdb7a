"""The tables of a simulation for people."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .terminal import STYLE, print_reasons

if TYPE_CHECKING:
    import pandas as pd

_INTEGRATORS = {
    "RK4 + Baumgarte": "RK4 +B",
    "RK4 + projection": "RK4 +P",
    "mj_step RK4": "mj_step",
    "World.step": "step",
}
"""What is too long for a narrow terminal; the setting says it in full."""


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.1e}"


def _errors(row: pd.Series, length: float) -> list[str]:
    """Errors, observed order, until when they were judged, and the verdict."""
    cut = row["judged_until"] < length
    verdict = str(row["verdict"])
    return [
        _number(row["pose_error"]),
        _number(row["rotation_error"]),
        "" if math.isnan(row["order"]) else f"{row['order']:.1f}",
        f"[{STYLE[verdict]}]{verdict}" + (f" to {row['judged_until']:.3g} s" if cut else "") + "[/]",
    ]


def _costs(row: pd.Series, length: float) -> list[str]:
    """Gap, energy, accelerations, wall time."""
    acceleration = float(np.fmax(row["a_error"], row["alpha_error"]))
    wall = "" if math.isnan(row["wall_per_second"]) else f"{row['wall_per_second']:.2f}"
    return [*(_number(x) for x in (row["loop_gap"], row["energy_defect"], acceleration)), wall]


_TABLES = (
    ("largest error against the {against}, observed order", ("pose m", "turn rad", "order", "verdict"), _errors),
    (
        "largest gap, energy defect over energy exchanged, accelerations over scale, s per s",
        ("gap m", "energy", "accel.", "wall"),
        _costs,
    ),
)


def print_simulation(simulation: pd.DataFrame, duration: float, console: Console) -> None:
    """Print errors and costs of every engine and method, how errors grow, what failed, and the verdict."""
    against = simulation.loc[simulation["against"] != "", "against"]
    which = {"motion": "prescribed motion", "analytic": "analytic solution"}.get(next(iter(against), ""), "solution")
    for title, heads, cells in _TABLES:
        console.print(title.format(against=which), highlight=False, style="italic")
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False, padding=(0, 1, 0, 0))
        for name in ("engine", "route", "integrator"):
            table.add_column(name, no_wrap=True)
        for name in ("dt s", *heads):
            table.add_column(name, justify="left" if name == "verdict" else "right", no_wrap=True)
        before = ("", "")
        for _, row in simulation.iterrows():
            where = (str(row["engine"]), str(row["route"]))
            shown = ("", "") if where == before else (where[0] if where[0] != before[0] else "", where[1])
            before = where
            integrator = _INTEGRATORS.get(str(row["integrator"]), str(row["integrator"]))
            dt = f"{row['dt']:.2g}" if row.notna()["dt"] else ""
            table.add_row(*shown, escape(integrator), dt, *cells(row, duration))
        console.print(table, crop=False)
        console.print()
    numbers = simulation[["growth_mean", "growth_max", "amplification"]].dropna()
    if len(numbers):
        mean, largest, factor = numbers.iloc[0]
        console.print(
            f"Forces are given, nothing is controlled: a small error grows at {mean:.2g} /s in the mean,"
            f"\nat {largest:.2g} /s at most, and so {factor:.3g} times in {duration:g} s.",
            highlight=False,
        )
    for _, row in simulation[simulation["verdict"] == "fail"].iterrows():
        which = " ".join(str(row[name]) for name in ("engine", "route", "integrator"))
        at = f" {row['dt']:.3g} s" if row.notna()["dt"] else ""
        console.print(
            f"[bold red]FAIL[/] {escape(which)}{at}: {escape(str(row['reason']))}", highlight=False, soft_wrap=True
        )
    print_reasons(simulation, console)
