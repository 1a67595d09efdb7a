"""Simulations side by side: errors of pose and energy, what they may be, and the table of them all.

An adaptive solution near round-off is held to a fixed bound.  Steps are held to the law of their order: two runs, one
with half the step of the other, differ by nearly all of the error of the coarser one, which needs no truth; a method of
order p that is r times finer has 1/(r^p - 1) of the difference left.  Where the law passes `NEAR`, it says nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..analytic.solve import longest_lever
from ..models.scene import Scene
from .bounds import of_floor, wider_accelerations
from .compare import ERROR, FAIL, PASS, UNSUPPORTED
from .credible import exchanged
from .engine import PLATFORM, DynamicsResult, Failure
from .problem import GRID, Problem
from .quaternions import times
from .scales import scales
from .stepping import Method, Simulated
from .tolerance import ACCELERATIONS, ENERGY, FOLLOWS, LAW_FACTOR, NEAR, QUADRATURE, of_accelerations
from .trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd

SETTLED = 10
"""Steps before errors fall as the order says; MuJoCo's soft loops sink in within the first few."""

EASY_GROWTH = 1e3
"""By how much errors may grow within the bound near round-off: the standing hexapod's do by 700 in a second."""

ORDER = 0.5
"""What an observed order may be off by where a law speaks for a part of the time alone; measured 0.01 to 0.2."""

QUADRATURE_ORDER = 6
"""Of a quintic spline in the distance of its points."""

NO_LAW = f"the law of these steps, or rounding, allows more than {NEAR:g} of the longest leg, or rad, from the start"

Row = tuple[str, Method]
"""Engine and method of a row."""


@dataclass(frozen=True)
class Solution:
    """The motion that errors are taken against, ``against``: `motion` or `analytic`.

    ``position`` (nt, 3), ``quaternion`` (nt, 4).  ``growth`` (nt,): rate at which a small error grows [1/s].
    """

    against: str
    position: np.ndarray
    quaternion: np.ndarray
    growth: np.ndarray

    def amplification(self, t: np.ndarray, since: float = 0.0) -> np.ndarray:
        """How often a small error at a time has grown by each of the times (nt,)."""
        rate = np.maximum(self.growth, 0.0)
        grown = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])
        return np.exp(np.maximum(grown - np.interp(since, t, grown), 0.0))


@dataclass(frozen=True)
class Accelerated:
    """Errors of accelerations along the scene's motion, over their scales, and the largest over its tolerance."""

    a: float
    alpha: float
    share: float


def apart(p: np.ndarray, q: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Distance [m] and angle [rad] (nt, 2) of poses p (nt, 3), q (nt, 4) from given ones."""
    turn = times(q, quaternion * [1.0, -1.0, -1.0, -1.0])
    angle = 2.0 * np.arctan2(np.linalg.norm(turn[:, 1:], axis=1), np.abs(turn[:, 0]))
    return np.column_stack([np.linalg.norm(p - position, axis=1), angle])


def pose_errors(s: Simulated, position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Distance [m] and angle [rad] (nt, 2) of a simulation's poses from given ones."""
    return apart(s.position, s.quaternion, position, quaternion)


def acceleration_errors(
    scene: Scene, trajectory: Trajectory, got: np.ndarray, truth: DynamicsResult, floor: float
) -> Accelerated:
    """Accelerations (nt, 6) against those of the motion that the forces are certified for.

    ``floor``: smallest moment of inertia [kg m^2] that the engine's format has.
    """
    size = scales(scene, trajectory, truth)
    want = np.hstack([trajectory.acceleration, trajectory.angular_acceleration])
    allowed = ACCELERATIONS.value * wider_accelerations(scene, trajectory, truth, size)
    errors = np.linalg.norm((got - want).reshape(-1, 2, 3), axis=2) / [size.of("a"), size.of("alpha")]
    share = errors / np.column_stack([allowed + of_floor(scene, trajectory, q, size, floor) for q in PLATFORM])
    return Accelerated(float(errors[:, 0].max()), float(errors[:, 1].max()), float(share.max()))


@dataclass(frozen=True)
class _Law:
    """What errors may be at the output times (nt, 2) [m, rad] and of the energy [J], until when, by which order."""

    name: str
    allowed: np.ndarray
    energy: float
    until: int
    order: float = np.nan


def hardness(problem: Problem) -> float:
    """How much more rounding a machine has than an easy one, at least 1: large forces, a steep start, far away."""
    platform, length = problem.scene.platform, problem.length
    lever = longest_lever(problem.scene.pins)
    per_force = max(1.0 / platform.mass, lever**2 / platform.least_inertia) / length
    share = per_force * float(np.abs(problem.forces(problem.t)).max())
    sine = problem.start.sin_q_n if problem.scene.parameters.leg.spins else np.ones(1)
    return float(of_accelerations(share, sine, problem.start.reach)[0])


def _rounding(problem: Problem, solution: Solution) -> np.ndarray:
    grown = np.maximum(solution.amplification(problem.t) / EASY_GROWTH, 1.0)
    return FOLLOWS.value * hardness(problem) * np.maximum(problem.t, 1.0) * grown


def _until(problem: Problem, allowed: np.ndarray) -> int:
    """Number of output times before what is allowed (nt, 2) says nothing."""
    vague = np.any(allowed > NEAR * np.array([problem.length, 1.0]), axis=1)
    return int(np.argmax(vague)) if vague.any() else len(allowed)


def _law(problem: Problem, solution: Solution, method: Method, own: Simulated, other: Simulated, ratio: float) -> _Law:
    """Law of one of two runs; the step of the other is so many times its own."""
    assert method.order is not None
    apart = np.maximum.accumulate(pose_errors(own, other.position, other.quaternion), axis=0)
    fine = max(ratio, 1.0 / ratio) ** method.order
    left = 1.0 / (fine - 1.0) if ratio > 1.0 else fine / (fine - 1.0)
    law, rounding = left * apart, _rounding(problem, solution)[:, None]
    until = max(_until(problem, law + rounding), 1)
    settled = np.searchsorted(problem.t, SETTLED * (method.dt(problem) or 0.0) * max(1.0, ratio))
    law[:settled] = law[min(settled, until - 1)]
    kept = slice(0, (until - 1) * problem.parts + 1)
    coarse = max(problem.spacing / GRID, 1.0) ** QUADRATURE_ORDER
    turnover = exchanged(problem, own) * QUADRATURE.value * coarse * hardness(problem)
    energy = LAW_FACTOR * 2.0 * float(np.abs(own.defect - other.defect)[kept].max()) + turnover
    allowed = LAW_FACTOR * law + rounding
    return _Law(f"law_of_order_{method.order}", allowed, energy, until, _order(solution, own, other, ratio, until))


def _order(solution: Solution, own: Simulated, other: Simulated, ratio: float, until: int) -> float:
    """Observed order: how the larger one of the errors at the last time that the law speaks for falls with the step."""
    a, b = (np.max(pose_errors(s, solution.position, solution.quaternion)[:until], axis=0) for s in (own, other))
    part = int(np.argmax(np.maximum(a, b)))
    with np.errstate(all="ignore"):
        return float(np.log(b[part] / a[part]) / np.log(ratio))


def partner(row: Row, rows: Sequence[Row]) -> Row | None:
    """The run with the other step of the same kind."""
    name, method = row
    same = [r for r in rows if r[0] == name and r[1]._replace(steps=method.steps) == method and r != row]
    return same[0] if same else None


NUMBERS = (
    "pose_error", "rotation_error", "order", "judged_until", "loop_gap", "energy_defect", "wall_per_second",
    "a_error", "alpha_error", "growth_mean", "growth_max", "amplification", "tolerance_pose",
    "tolerance_rotation",
)  # fmt: skip


def table(
    run_id: str,
    problem: Problem,
    solution: Solution | None,
    versions: Mapping[str, str],
    results: Mapping[Row, Simulated | Failure],
    accelerated: Mapping[tuple[str, str], Accelerated | Failure],
) -> pd.DataFrame:
    """Every expected row, whether its engine ran or not."""
    import pandas as pd

    rows = []
    for (name, method), result in results.items():
        row: dict = {
            "run_id": run_id,
            "scene": problem.scene.name,
            "engine": name,
            "engine_version": versions.get(name, ""),
            "route": method.route,
            "setting": method.setting,
            "integrator": method.integrator,
            "dt": method.dt(problem),
            "against": "",
        }
        row |= dict.fromkeys(NUMBERS, np.nan) | {"tolerance_name": "", "verdict": ERROR, "wrong": "", "reason": ""}
        if method.unsupported:
            row |= {"verdict": UNSUPPORTED, "reason": method.unsupported}
        elif isinstance(result, Failure):
            row["reason"] = result.reason
        elif solution is None:
            row["reason"] = "no analytic solution to compare with"
        else:
            numbers, wrong = judge(problem, solution, (name, method), results, accelerated.get((name, method.route)))
            row |= numbers | (
                {"verdict": FAIL, "wrong": " ".join(wrong), "reason": "; ".join(wrong.values())} if wrong else {}
            )
        rows.append(row)
    return pd.DataFrame(rows)


def judge(
    problem: Problem,
    solution: Solution,
    key: Row,
    results: Mapping[Row, Simulated | Failure],
    accelerated: Accelerated | Failure | None = None,
) -> tuple[dict, dict[str, str]]:
    """Numbers of one simulation, with a verdict, and what is wrong with it, by quantity."""
    _, method = key
    own = results[key]
    assert isinstance(own, Simulated)
    itself = own.position is solution.position
    turnover = exchanged(problem, own)
    defect = np.abs(own.defect)
    row = {
        "against": "" if itself else solution.against,
        "loop_gap": own.gap,
        "energy_defect": float(defect.max()) / turnover,
        "wall_per_second": own.seconds / problem.duration,
        "growth_mean": float(solution.growth.mean()),
        "growth_max": float(solution.growth.max()),
        "amplification": float(solution.amplification(problem.t)[-1]),
    }
    nt = len(problem.t)
    if method.steps is None:
        both = np.repeat(_rounding(problem, solution)[:, None], 2, axis=1)
        law = _Law(FOLLOWS.name, both, ENERGY.value * hardness(problem) * turnover, max(_until(problem, both), 1))
    else:
        other_key = partner(key, list(results))
        other = results.get(other_key) if other_key else None
        if not isinstance(other, Simulated) or other_key is None:
            reason = "the run with the other step, which gives the law, failed"
            return row | {"verdict": UNSUPPORTED, "reason": reason}, {}
        assert other_key[1].steps is not None
        law = _law(problem, solution, method, own, other, method.steps / other_key[1].steps)
    if law.until < 2:
        return row | {"verdict": UNSUPPORTED, "reason": NO_LAW}, {}
    wrong = {}
    errors = np.zeros((nt, 2)) if itself else pose_errors(own, solution.position, solution.quaternion)
    if not itself:
        row |= {"pose_error": float(errors[:, 0].max()), "rotation_error": float(errors[:, 1].max())}
        last = law.until - 1
        row |= {"tolerance_name": law.name, "order": law.order, "judged_until": float(problem.t[last])}
        row |= dict(zip(("tolerance_pose", "tolerance_rotation"), law.allowed[last].tolist(), strict=True))
        for column, (what, unit) in enumerate((("pose", "m"), ("rotation", "rad"))):
            share = errors[: law.until, column] / law.allowed[: law.until, column]
            if not share.max() <= 1.0:
                k = int(np.argmax(share))
                wrong[what] = (
                    f"{what} {errors[k, column]:.2e} {unit} at t = {problem.t[k]:.6g} s, allowed"
                    f" {law.allowed[k, column]:.1e} ({law.name})"
                )
    if law.until < nt and not abs(law.order - (method.order or 0)) <= ORDER:
        wrong["order"] = f"the errors fall with the step by order {law.order:.2f}, expected {method.order}"
    judged = defect[: (law.until - 1) * problem.parts + 1].max()
    if not judged <= law.energy:
        wrong["energy"] = f"energy defect {judged:.2e} J, allowed {law.energy:.1e} J"
    if isinstance(accelerated, Accelerated):
        row |= {"a_error": accelerated.a, "alpha_error": accelerated.alpha}
        if not accelerated.share <= 1.0:
            wrong["accelerations"] = (
                f"accelerations {max(accelerated.a, accelerated.alpha):.2e} of their scale, allowed"
                f" {ACCELERATIONS.value:.0e} and more where ill-conditioned"
            )
    if isinstance(accelerated, Failure):
        return row | {"verdict": ERROR, "reason": f"accelerations: {accelerated.reason}"}, {}
    return row | {"verdict": PASS}, wrong
