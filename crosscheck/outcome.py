"""What became of an answer in a hard place: accurate, degraded, refused or silent."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..models.scene import Scene
from .bounds import allowed, of_floor, wider_accelerations
from .certainty import Certain, condition_of_forces
from .compare import certified, forward_quantities
from .engine import HULL, DynamicsResult, Failure, platform_quantity, values
from .hard import Accelerated, Point
from .scales import Scales, scales
from .stress_work import INVERSE, Answer, Method
from .tolerance import ACCELERATIONS, LIMIT
from .trajectory import Trajectory, TrajectoryError, instant, platform_alone

ACCURATE, DEGRADED, REFUSED, SILENT = OUTCOMES = ("accurate", "degraded", "refused", "silent")

NEAR_SENSITIVITY = 100.0
"""An answer within so many times what half-ulp inputs move the exact one by is accurate: it has a few hundred roundings
of its own, and each of them counts like one of an input."""

NO_DIGITS = "no digits"
"""How the reason begins where an answer is off by more than a tenth of its scale, and its route has said so."""

ROUNDING = 2.0**-53
"""Least sensitivity: the inputs may leave an answer alone, but what it is measured by is rounded itself."""


@dataclass(frozen=True)
class Place:
    """A point with its truth: what answers to one problem are judged by.

    ``at``: the motion, with the accelerations of the truth; ``joints``: the same with joint coordinates, if the pose
    has any.
    """

    point: Point
    truth: Certain
    at: Trajectory
    joints: Trajectory | None
    size: Scales

    @classmethod
    def of(cls, point: Point, truth: Certain) -> Place:
        """The place where an answer was asked for."""
        scene, row, result = point.scene, point.row, truth.result
        if result.platform is not None:
            a = result.platform[0].tolist()
            row = row._replace(acceleration=tuple(a[:3]), angular_acceleration=tuple(a[3:]))
        at = platform_alone(scene, row)
        try:
            joints = instant(scene, row, inverse=result.platform is None)
        except TrajectoryError:
            joints = None
        return cls(point, truth, at, joints, scales(scene, at, result))

    def sensitivity(self, name: str) -> float:
        """Of a quantity, over its scale."""
        return max(self.truth.sensitivity[name] / self.size.of(name), ROUNDING)

    def exact(self, name: str) -> np.ndarray:
        """A quantity of the truth, vectors of the legs (n, k)."""
        if name in ("a", "alpha"):
            return platform_quantity(name, np.asarray(self.truth.result.platform))[0]
        return certified(self.point.scene, self.truth.result, name)[0][0]

    def stated(self, answer: Answer, name: str, floor: float) -> float:
        """Tolerance that the route states here; infinite where it says nothing, NaN without joint coordinates."""
        scene, at, truth = self.point.scene, self.joints, self.truth.result
        if isinstance(answer, Accelerated) and answer.rounding_alone:
            return np.finfo(float).eps * answer.growth
        if at is None:
            return np.nan
        with np.errstate(all="ignore"):
            if isinstance(answer, DynamicsResult):
                return float(allowed(scene, at, answer, truth, name, self.size, floor)[0][0])
            rounding = ACCELERATIONS.value * wider_accelerations(scene, at, truth, self.size)
            rounding = np.maximum(rounding, np.finfo(float).eps * answer.growth)
            return float((rounding + of_floor(scene, at, name, self.size, floor))[0])


def quantities(scene: Scene, method: Method) -> tuple[str, ...]:
    """What a method is asked for, whether it answers or not."""
    if method.problem == INVERSE:
        return (*scene.quantities, *HULL)
    reactions = (*scene.quantities[1:], *HULL) if method.with_reactions else ()
    return (*reactions, *forward_quantities(scene))


def judge(
    point: Point,
    place: Place | Failure,
    method: Method,
    answer: Answer | Failure,
    floor: float = 0.0,
    states_nothing: bool = False,
) -> Iterator[dict[str, Any]]:
    """Rows of one answer: quantity, error, sensitivity, condition, outcome, tolerance and reason.

    ``floor``: smallest moment of inertia [kg m^2] of the engine's format.  ``states_nothing``: no tolerance counts.
    """
    nothing = {"max_rel_error": np.nan, "input_sensitivity": np.nan, "condition": np.nan, "stated": np.nan}
    for name in quantities(point.scene, method):
        row: dict[str, Any] = {"quantity": name, **nothing}
        if isinstance(place, Place):
            row |= {"input_sensitivity": place.sensitivity(name), "condition": place.truth.condition}
        elif method.problem == INVERSE:
            row["condition"] = condition_of_forces(point)
        if isinstance(answer, Failure):
            yield row | {"outcome": REFUSED, "reason": answer.reason}
        elif isinstance(place, Failure):
            yield row | {"outcome": SILENT, "reason": f"an answer where there is no certain one: {place.reason}"}
        else:
            error = _error(place, answer, name)
            stated = 0.0 if states_nothing else place.stated(answer, name, floor)
            outcome, reason = outcome_of(error, row["input_sensitivity"], stated)
            yield row | {"max_rel_error": error, "stated": stated, "outcome": outcome, "reason": reason}


def _error(place: Place, answer: Answer, name: str) -> float:
    if isinstance(answer, DynamicsResult):
        got = values(place.point.scene, answer, name)[0]
    else:
        got = platform_quantity(name, answer.platform)[0]
    return float(np.linalg.norm(got - place.exact(name), axis=1).max() / place.size.of(name))


def outcome_of(error: float, sensitivity: float, stated: float) -> tuple[str, str]:
    """Outcome of a relative error, and why."""
    beyond = f"{error / sensitivity:.1e} times the input sensitivity"
    if not np.isfinite(error):
        return SILENT, "no finite number"
    if error <= NEAR_SENSITIVITY * sensitivity:
        if error <= LIMIT:
            return ACCURATE, ""
        return DEGRADED, f"{NO_DIGITS}: half-ulp inputs change the exact answer by {sensitivity:.1e} of its scale"
    if stated > LIMIT:
        return DEGRADED, f"{NO_DIGITS if error > LIMIT else beyond}: the route states that nothing is certain here"
    if error <= stated:
        return DEGRADED, f"{beyond}, within the {stated:.1e} that the route states"
    if not stated > 0.0:
        return SILENT, f"{beyond}, and the route states no tolerance here"
    return SILENT, f"{beyond}, {error / stated:.1e} times what the route states"
