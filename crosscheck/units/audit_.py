"""The text of the paper: every equation and every misprint, measured."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ..audit import TABLE, TEXT_ONLY
from ..unit import Key, Row, Unit, read, row

ORDER = 1
SECONDS = 60.0
ROUNDING = 0.1
"""Of a tolerance of the audit: each allows for some ten to twenty of the residuals that were measured."""


def units() -> list[Unit]:
    """The audit is one command."""
    return [Unit("audit", ("audit",), SECONDS, expected, checks)]


def _key(kind: str, name: str) -> Key:
    return Key("", "analytic", "closed_form", kind, name)


def expected() -> Iterable[Key]:
    """What is measured; misprints of words are not."""
    return [_key(row.kind, row.key) for row in TABLE if row.residual is not None and row.tolerance is not None]


def checks(folder: Path) -> Iterable[Row]:
    """One row for each measured one of audit.csv."""
    for found in read(folder / "audit.csv").to_dict("records"):
        if found["verdict"] != TEXT_ONLY:
            numbers = found["residual"], found["tolerance"], ROUNDING * found["tolerance"]
            yield row(_key(found["kind"], found["row"]), *numbers, found["verdict"], reason=found["reason"])
