"""Every scene simulated in every engine under the same driving forces."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path

import numpy as np

from ...models import load_scene, scene_names
from ..engine import REFERENCE, Failure
from ..problem import pose
from ..run import choose_engines
from ..stepping import Method
from ..tasks import simulates
from ..tolerance import ACCELERATIONS, ENERGY, FOLLOWS, QUADRATURE
from ..trajectory import SAMPLES
from ..unit import Key, Row, Unit, read, row

ORDER = 2
SECONDS = 120.0
"""Some ten times what the hexapod takes."""

DURATION = 1.0
"""Seconds that are simulated: long enough for every term to act, and errors do not yet grow much."""

QUANTITIES = {
    "pose": ("pose_error", "tolerance_pose"),
    "rotation": ("rotation_error", "tolerance_rotation"),
    "energy": ("energy_defect", ""),
    "accelerations": ("a_error", ""),
    "order": ("", ""),
}
"""What is judged of a simulation: its error and its tolerance in simulation.csv, where they stand there."""


def units() -> list[Unit]:
    """One for each built-in scene."""
    command = ("--duration", f"{DURATION:g}")
    return [
        Unit(f"simulate-{name}", ("simulate", name, *command), SECONDS, partial(expected, name), partial(checks, name))
        for name in scene_names()
    ]


def _keys(scene: str, engine: str, route: str, integrator: str, dt: str) -> list[Key]:
    setting = f"{integrator} {dt}".strip()
    return [Key(scene, engine, route, setting, quantity) for quantity in QUANTITIES]


def _dt(dt: float | None) -> str:
    return "" if dt is None or np.isnan(dt) else f"dt {dt:.3g} s"


def expected(name: str) -> Iterable[Key]:
    """Every quantity of every method of every engine."""
    problem = pose(load_scene(name), DURATION, SAMPLES)
    for engine, found in choose_engines([]).items():
        if isinstance(found, Failure):
            methods = (Method("", "", ""),) if engine != REFERENCE else ()
        else:
            methods = found.methods(problem) if simulates(found) else ()
        for method in methods:
            yield from _keys(name, engine, method.route, method.integrator, _dt(method.dt(problem)))


def checks(name: str, folder: Path) -> Iterable[Row]:
    """Rows for each of simulation.csv; a failure is that of the quantities that it names."""
    for found in read(folder / "simulation.csv").to_dict("records"):
        wrong = found["wrong"].split()
        why = dict(zip(wrong, found["reason"].split("; "), strict=True)) if wrong else {}
        steps = not np.isnan(found["dt"])
        rounding = {
            "pose": FOLLOWS.rounding * np.nanmax([found["amplification"], 1.0]),
            "energy": QUADRATURE.rounding if steps else ENERGY.rounding,
            "accelerations": ACCELERATIONS.rounding,
        }
        rounding["rotation"] = rounding["order"] = rounding["pose"]
        for key in _keys(name, found["engine"], found["route"], found["integrator"], _dt(found["dt"])):
            error, tolerance = (found[column] if column else np.nan for column in QUANTITIES[key.quantity])
            if key.quantity == "accelerations":
                error = np.fmax(error, found["alpha_error"])
            verdict = found["verdict"]
            if wrong and key.quantity not in wrong:
                verdict = "pass"
            elif found["judged_until"] < DURATION:  # the largest error is a later one
                tolerance = np.nan
            yield row(
                key,
                error,
                tolerance,
                rounding[key.quantity],
                verdict,
                reason=why.get(key.quantity, "") if wrong else found["reason"],
            )
