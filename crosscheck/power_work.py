"""What `run` says of one planted fault, and the smallest fault that it detects: bodies of worker processes."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import math
import pickle
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from ..models import write_models
from ..models.scene import Scene
from . import compare
from .checks import inverse_dynamics
from .engine import REFERENCE, DynamicsResult, Engine, EngineError, is_forward, load_engine, require_complete
from .trajectory import Trajectory, from_scene

FORMULAS = "analytic"
"""The engine that the formulas are; it reads no model file, but the scene itself."""

FIRST, LARGEST = 1e-3, 1.0
"""Relative faults: the one that is tried first, and the one beyond which nobody looks."""

GAP = 0.5
"""A smallest fault is known when one that is this many times as large is not detected."""

TRIES = 40
"""Of which three are the usual number."""


NOTHING = "nothing that is compared depends on it"
"""Why a fault is not seen that changes no number of an answer."""


@dataclass(frozen=True)
class Place:
    """A scene with its motion and its certified truth: what stays right, whatever is planted."""

    scene: Scene
    trajectory: Trajectory
    truth: DynamicsResult


class Planted(NamedTuple):
    """What an engine is given in place of the right things: a scene, its model files, a trajectory."""

    scene: Scene
    models: dict[str, str]
    trajectory: Trajectory


class Fault(Protocol):
    """A fault of any size."""

    def planted(self, place: Place, engine: str, d: float) -> contextlib.AbstractContextManager[Planted]:
        """What an engine is given while the fault is there, `d` times as large as what it is a share of."""
        ...


class Seen(NamedTuple):
    """What the table of `run` makes of a fault.

    ``share``: largest error over what is allowed; ``quantity``: whose; ``detected``: whether a row fails; ``refused``:
    what was said in place of an answer, which is a detection, too; ``digest``: of the numbers that the engine gave.
    """

    share: float
    quantity: str
    detected: bool
    refused: str = ""
    digest: str = ""


class Smallest(NamedTuple):
    """The smallest relative fault that is detected, what sees it, and the largest one tried that is not.

    Without one it is NaN, and ``reason`` says why.
    """

    detected: float
    missed: float
    seen_by: str
    reason: str = ""


@functools.lru_cache(maxsize=4)
def place_of(path: Path) -> Place:
    """A place from a `shared` file."""
    with open(path, "rb") as file:
        return pickle.load(file)


def handed(engine: type[Engine], scene: Scene) -> type[Engine]:
    """The engine, which is handed this scene whatever scene it is made with: all checks use the right one."""

    def __init__(self: Engine, _: Scene, models: dict[str, str] | None = None) -> None:
        engine.__init__(self, scene, models)

    return type(engine.__name__, (engine,), {"__init__": __init__})


def answer(place: Place, name: str, route: str, given: Planted) -> DynamicsResult:
    """What an engine answers on a route, as `run` asks for it. Raises EngineError."""
    engine = handed(load_engine(name), given.scene)
    try:
        if route == engine.route:
            return inverse_dynamics(name, engine, place.scene, given.models, given.trajectory)
        assert is_forward(engine)
        at = given.trajectory.at(place.truth.samples).without_accelerations()
        result = engine(place.scene, given.models).forward_dynamics(at, place.truth.F)
        require_complete(name, engine, route, place.scene, at, result)
    except EngineError:
        raise
    except Exception as e:  # whatever an engine's library raises is that engine's failure, as in `run`
        raise EngineError(f"{type(e).__name__}: {e}") from None
    return replace(result, samples=place.truth.samples)


def seen(place: Place, name: str, route: str, fault: Fault, d: float) -> Seen:
    """What the rows of an engine and a route in the table of `run` say with a fault planted."""
    engines = {name: load_engine(name), REFERENCE: load_engine(REFERENCE)}
    try:
        with fault.planted(place, name, d) as given, np.errstate(all="ignore"):
            result = answer(place, name, route, given)
            results = {(name, route): result, (REFERENCE, engines[REFERENCE].route): place.truth}
            table = compare.agreement("", place.scene, given.trajectory, engines, results)
    except EngineError as e:
        return refusal(str(e))
    rows = table[table["engine"] == name]
    fails = rows[rows["verdict"] == compare.FAIL]
    judged = fails if len(fails) else rows[rows["verdict"] == compare.PASS]
    if not len(judged):
        return Seen(0.0, "", False, digest=_digest(result))
    shares = judged["share"].fillna(math.inf).to_numpy()
    worst = int(np.argmax(shares))
    return Seen(float(shares[worst]), str(judged["quantity"].iloc[worst]), len(fails) > 0, digest=_digest(result))


def refusal(reason: str) -> Seen:
    """An error in place of an answer."""
    return Seen(math.inf, "refusal", True, reason)


def _digest(result: DynamicsResult) -> str:
    """Of all numbers that rows are made of."""
    arrays = [result.F, result.reactions, *([] if result.platform is None else [result.platform])]
    arrays += [worst.error for worst in result.checks.values()]
    return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()


def smallest(look: Callable[[float], Seen], right: str) -> Smallest:
    """The smallest relative fault that is detected, to a factor of `GAP`; each end of the bracket was looked at.

    ``right``: digest without a fault.  Errors grow in proportion to a small fault: the first one that is detected says
    where the smallest will be.
    """
    missed, detected, by = 0.0, math.inf, Seen(0.0, "", False)
    d = FIRST
    for _ in range(TRIES):
        now = look(d)
        if now.detected:
            detected, by = d, now
        elif d >= LARGEST:
            return Smallest(math.nan, d, "", _blind(now, right))
        else:
            missed = d
        if missed >= GAP * detected:
            return Smallest(detected, missed, by.quantity, by.refused)
        d = _next(missed, detected, by.share)
    return Smallest(detected, missed, by.quantity, f"the smallest lies anywhere down to {missed:.1e}")


def _next(missed: float, detected: float, share: float) -> float:
    """What to try between a fault that is missed and one that is detected."""
    if math.isinf(detected):
        return LARGEST
    tried = detected / share * (1.2 if share > 1.5 else 0.8)  # one is seen, the other missed: closer than `GAP`
    if missed < tried < detected:
        return tried
    return math.sqrt(missed * detected) if missed else detected * 1e-3


def _blind(wrong: Seen, right: str) -> str:
    """Why a fault as large as what it is a share of is not seen."""
    if wrong.digest == right:
        return NOTHING
    return f"at 100 % its error is {wrong.share:.2g} of what is allowed"


@contextlib.contextmanager
def right(place: Place) -> Iterator[Planted]:
    """Nothing planted."""
    yield Planted(place.scene, write_models(place.scene), place.trajectory)


def anew(place: Place) -> Trajectory:
    """The scene's own motion, worked out again by what formulas there are now. Raises EngineError."""
    try:
        return from_scene(place.scene, len(place.trajectory.t))
    except Exception as e:  # no joint coordinates: whatever is said, nobody takes it for an answer
        raise EngineError(f"{type(e).__name__}: {e}") from None
