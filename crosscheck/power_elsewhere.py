"""Terms of the formulas that `run` does not see on a scene: which other command does."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from . import audit, power_terms
from .engine import load_engine
from .power_faults import Term, coordinates_and_forces
from .power_tasks import BLIND, nobody, two_rows
from .power_work import FORMULAS, Seen, place_of, refusal, seen
from .simulation import acceleration_errors
from .stepping import Method
from .tasks import simulates

ROUTES = {"spatial": ("closed_form", "dae"), "planar": ("closed_form",)}
"""Routes of `simulate`, by the scene's topology, whose accelerations it compares."""


class Judge(NamedTuple):
    """A command that evaluates some terms: the scene it does so on, its route, and what it says of a fault."""

    command: str
    scene: str
    route: str
    reached: frozenset[int]
    look: Callable[[int, float], Seen]


@functools.cache
def judges(paths: tuple[Path, ...]) -> tuple[Judge, ...]:
    """`run` on other scenes, `audit`, accelerations of `simulate` on all."""
    moving = [(path, route) for path in paths for route in ROUTES[place_of(path).scene.topology]]
    return (*map(_run, paths[1:]), _audit(), *(_simulate(path, route) for path, route in moving))


def _run(path: Path) -> Judge:
    place, route = place_of(path), load_engine(FORMULAS).route
    reached = frozenset(coordinates_and_forces(place))
    return Judge(
        "run", place.scene.name, route, reached, lambda number, d: seen(place, FORMULAS, route, Term(number), d)
    )


def _audit() -> Judge:
    """The rows of the paper's text."""
    cases = audit.cases()
    entries: dict[int, list[audit.Row]] = {}
    for entry in audit.TABLE:
        with power_terms.recorded() as values:
            if entry.residual is not None:
                audit.measured(entry, cases)
        for number in values:
            known = entries.setdefault(number, [])
            if entry.kind == "equation" or not known:  # other rows hold what no equation does
                known.append(entry)

    def look(number: int, d: float) -> Seen:
        try:
            with power_terms.faulty(number, d), np.errstate(all="ignore"):
                found = [audit.measured(entry, cases) for entry in entries[number]]
        except (ArithmeticError, ValueError) as e:
            return refusal(f"{type(e).__name__}: {e}")
        shares: list[Any] = [f["residual"] / f["tolerance"] for f in found]  # pyright: ignore[reportOperatorIssue]
        worst = int(np.argmax(shares))
        fails = any(f["verdict"] == audit.FAILS for f in found)
        return Seen(_number(shares[worst]), str(found[worst]["row"]), fails, digest=repr(shares))

    return Judge("audit", "", "printed", frozenset(entries), look)


def _simulate(path: Path, route: str) -> Judge:
    """Accelerations under certified driving forces."""
    place = place_of(path)
    engine = load_engine(FORMULAS)
    assert simulates(engine)
    made = engine(place.scene)
    at = place.trajectory.at(place.truth.samples)

    def accelerations() -> np.ndarray:
        return made.accelerations(Method(route, "", ""), at, place.truth.F)

    def look(number: int, d: float) -> Seen:
        try:
            with power_terms.faulty(number, d), np.errstate(all="ignore"):
                got = accelerations()
        except (ArithmeticError, ValueError) as e:
            return refusal(f"{type(e).__name__}: {e}")
        found = acceleration_errors(place.scene, at, got, place.truth, 0.0)
        return Seen(_number(found.share), "accelerations", not found.share <= 1.0, digest=repr(got.tobytes()))

    with power_terms.recorded() as values:
        accelerations()
    return Judge("simulate", place.scene.name, route, frozenset(values), look)


def _number(share: float) -> float:
    return math.inf if math.isnan(share) else float(share)


@functools.cache
def _right(judge: Judge, number: int) -> str:
    """Digest without a fault; the audit's is that of the rows which work out a term."""
    return judge.look(number, 0.0).digest


def asked(paths: tuple[Path, ...], number: int) -> Iterator[Judge]:
    """Commands that evaluate a term."""
    return (judge for judge in judges(paths) if number in judge.reached)


def of_other_terms(paths: Sequence[Path], items: Sequence[int]) -> list[dict[str, Any]]:
    """Rows of terms by the first command that sees them, else by one that evaluates them, if there is any."""
    rows = []
    for number in items:
        found = [nobody(number)]
        for judge in asked(tuple(paths), number):
            more = {"command": judge.command, "scene": judge.scene, "engine": FORMULAS, "route": judge.route}
            found = two_rows(number, functools.partial(judge.look, number), _right(judge, number), more)
            if found[0]["verdict"] != BLIND:
                break
        rows += found
    return rows
