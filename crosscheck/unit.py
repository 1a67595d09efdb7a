"""Units of a night: one command each, the rows that it must bring, and how its files become rows.

A kind of unit is a module ``units/NAME_.py`` with a function ``units``. Adding one is adding a file.
"""

from __future__ import annotations

import csv
import importlib
import pkgutil
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from . import units

if TYPE_CHECKING:
    import pandas as pd

Row = dict[str, Any]


class Key(NamedTuple):
    """What a row of a unit is about, the unit itself aside: see `reports.checks`."""

    scene: str
    engine: str
    route: str
    setting: str
    quantity: str


@dataclass(frozen=True)
class Unit:
    """One command of a night.

    ``arguments`` of `crosscheck`, but for --out.  ``seconds``: time limit.  ``expected``: keys of the rows that it must
    bring, worked out without running it.  ``checks``, ``times``: rows made of a folder of its results.
    """

    name: str
    arguments: tuple[str, ...]
    seconds: float
    expected: Callable[[], Iterable[Key]]
    checks: Callable[[Path], Iterable[Row]]
    times: Callable[[Path], Iterable[Row]] = lambda folder: ()

    def reproduce(self, engine: str) -> str:
        """A command line for one row."""
        chosen = ("--engine", engine) if engine and self.arguments[0] != "audit" else ()
        return " ".join(("crosscheck", *self.arguments, *chosen))


class UnknownUnit(ValueError):
    """No unit of that name; the message lists the valid ones."""


def all_units() -> dict[str, Unit]:
    """Units by name: comparisons first, what takes long last."""
    names = sorted(m.name for m in pkgutil.iter_modules(units.__path__) if m.name.endswith("_"))
    modules = [importlib.import_module(f"{units.__name__}.{name}") for name in names]
    made = [unit for module in sorted(modules, key=lambda m: m.ORDER) for unit in module.units()]
    return {unit.name: unit for unit in made}


def choose_units(names: Iterable[str]) -> dict[str, Unit]:
    """Units by name, all if none is named. Raises UnknownUnit."""
    known = all_units()
    wanted = list(names)
    for name in wanted:
        if name not in known:
            raise UnknownUnit(f"--unit: got an unknown unit {name!r}, expected one of {', '.join(known)}")
    return {name: unit for name, unit in known.items() if not wanted or name in wanted}


def row(key: Key, error: float, tolerance: float, floor: float, verdict: str, **more: Any) -> Row:
    """A row of checks: a margin only where something is promised."""
    margin = error / tolerance if tolerance > 0.0 else np.nan
    nothing = {"reason": "", "where": ""}
    numbers = {"error": error, "tolerance": tolerance, "floor": floor, "margin": margin, "verdict": verdict}
    return {**key._asdict(), **numbers, **nothing, **more}


def missing(key: Key, reason: str) -> Row:
    """A row that was expected and has not come."""
    return row(key, np.nan, np.nan, np.nan, "error", reason=reason)


TEXTS = (
    "scene", "engine", "engine_version", "route", "setting", "quantity", "tolerance_name", "verdict", "reason", "where",
    "wrong", "row", "kind", "case", "parameter", "outcome", "integrator", "task", "backend",
)  # fmt: skip


def read(path: Path) -> pd.DataFrame:
    """A CSV file of results: texts stay texts, an empty one too; an empty number is NaN."""
    import pandas as pd

    with open(path, encoding="utf-8", newline="") as file:
        names = next(csv.reader(file), [])
    texts = {name: str for name in names if name in TEXTS}
    empty = {name: [""] for name in names if name not in texts}
    return pd.read_csv(path, dtype=texts, keep_default_na=False, na_values=empty)
