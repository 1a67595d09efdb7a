"""Every scene in every engine, on each of its routes: inverse dynamics along the scene's own motion."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path

from ...models import load_scene, scene_names
from ..compare import expected as quantities
from ..engine import Failure, routes
from ..run import choose_engines
from ..tolerance import CLOSURE, RADIUS, ROUND_OFF
from ..unit import Key, Row, Unit, read, row

ORDER = 0
SECONDS = 60.0
"""Twenty times what the hexapod takes."""


def units() -> list[Unit]:
    """One for each built-in scene."""
    return [
        Unit(f"run-{name}", ("run", name), SECONDS, partial(expected, name), partial(checks, name))
        for name in scene_names()
    ]


def expected(name: str) -> Iterable[Key]:
    """Every quantity of every route of every engine."""
    scene = load_scene(name)
    for engine, found in choose_engines([]).items():
        able = None if isinstance(found, Failure) else found
        for route in routes(able) if able else ("",):
            for quantity in quantities(scene, able, route):
                yield Key(name, engine, route, "", quantity)


def rounding(tolerance_name: str, tolerance: float) -> float:
    """What rounding alone may be of an error that is held to a tolerance: it grows where the tolerance does."""
    base = next((t for t in (CLOSURE, RADIUS) if tolerance_name.startswith(t.name)), ROUND_OFF)
    wider = 1.0 if tolerance_name.startswith("law_of") else max(1.0, tolerance / base.value)
    return base.rounding * wider


def checks(name: str, folder: Path) -> Iterable[Row]:
    """One row for each of agreement.csv; the margin is the largest of all samples, each under its own tolerance."""
    agreement, margins = read(folder / "agreement.csv"), read(folder / "margins.csv")
    for found, more in zip(agreement.to_dict("records"), margins.to_dict("records"), strict=True):
        key = Key(name, found["engine"], found["route"], "", found["quantity"])
        tolerance = float(found["tolerance"])
        floor = rounding(found["tolerance_name"], tolerance)
        made = row(key, found["max_rel"], tolerance, floor, found["verdict"], reason=more["reason"])
        yield made | {"margin": more["margin"], "where": more["where"]}
