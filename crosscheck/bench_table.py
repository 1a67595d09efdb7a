"""The tables of `bench`: errors of answers, quantiles of times, and what a time is compared with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..models.scene import Scene
from .bounds import allowed
from .compare import certified
from .engine import REFERENCE, DynamicsResult, EngineError, Failure, quantity
from .problem import Problem
from .scales import Scales, scales
from .simulation import acceleration_errors, apart
from .sweep import LEGS, TASKS, Case
from .trajectory import Trajectory

DECADE = 10.0
"""Errors within it are called equal."""

QUANTILES = (0.5, 0.1, 0.9)


class Error(NamedTuple):
    """Largest error over its scale, and over what is allowed (0 where nothing is)."""

    relative: float
    share: float = 0.0


@dataclass(frozen=True)
class Timed:
    """A case that ran: seconds per sample of every round, its error, memory [bytes] of one batch."""

    seconds: Sequence[float]
    error: Error | None
    peak: int

    def us(self) -> np.ndarray:
        """Median, p10 and p90 [µs per sample]."""
        return np.quantile(np.array(self.seconds) * 1e6, QUANTILES)


@dataclass(frozen=True)
class Truth:
    """What answers are compared with: certified forces along samples, and a motion in time."""

    scene: Scene
    trajectory: Trajectory
    certified: DynamicsResult
    problem: Problem

    def error(self, case: Case, answer: Any, floor: float = 0.0) -> Error | None:
        """Error of an answer, None where there is none. Raises EngineError: a wrong shape, a value not finite.

        ``floor``: smallest moment of inertia [kg m^2] of the engine's format.
        """
        if answer is None:
            return None
        if case.task == "simulate":
            return self._poses(case, *answer)
        truth, size = self.certified, scales(self.scene, self.trajectory, self.certified)
        if case.task == "forward_step":
            self._require(case, answer, (len(self.trajectory.t), 6))
            found = acceleration_errors(self.scene, self.trajectory, answer, truth, floor)
            return Error(max(found.a, found.alpha), found.share)
        F, reactions = answer if case.task == "all_reactions" else (answer, None)
        self._require(case, F, truth.F.shape)
        got = replace(truth, engine=case.engine, route=case.route, F=F, radius={}, hull=None)
        names = ("F",)
        if reactions is not None:
            self._require(case, reactions, truth.reactions.shape)
            got, names = replace(got, reactions=reactions), self.scene.quantities
        return max((self._forces(case, got, name, size, floor) for name in names), key=lambda e: e.relative)

    def _forces(self, case: Case, got: DynamicsResult, name: str, size: Scales, floor: float) -> Error:
        truth = self.certified
        want = quantity(self.scene, name, truth.F, truth.reactions)
        if case.engine == REFERENCE:
            return Error(float(np.linalg.norm(certified(self.scene, truth, name)[1], axis=2).max()) / size.of(name))
        off = quantity(self.scene, name, got.F, got.reactions) - want
        off = np.linalg.norm(off, axis=2).max(axis=1) / size.of(name)
        bound, _ = allowed(self.scene, self.trajectory, got, truth, name, size, floor)
        return Error(float(off.max()), float((off / bound).max()))

    def _poses(self, case: Case, position: np.ndarray, quaternion: np.ndarray) -> Error:
        motion = self.problem.motion()
        self._require(case, position, motion.position.shape)
        self._require(case, quaternion, motion.unit_quaternion.shape)
        off = apart(position, quaternion, motion.position, motion.unit_quaternion)
        return Error(float((off / [self.problem.length, 1.0]).max()))

    def _require(self, case: Case, got: Any, shape: tuple[int, ...]) -> None:
        if np.shape(got) != shape:
            raise EngineError(f"{case}: got shape {np.shape(got)}, expected {shape}")
        if not np.isfinite(got).all():
            raise EngineError(f"{case}: the answer is not finite")


def ratio_to_fastest(rows: pd.DataFrame) -> np.ndarray:
    """Time over that of the fastest equal row of the task, itself among them.

    Equal: its error is at most ten times this one's, and it takes at most as many samples at a time.
    """
    out = np.full(len(rows), np.nan)
    task = rows["task"].to_numpy()
    us, error, batch = (rows[name].to_numpy(dtype=float) for name in ("us_per_sample", "max_rel_error", "batch"))
    for k in np.flatnonzero(np.isfinite(us) & np.isfinite(error)):
        equal = (task == task[k]) & (error <= DECADE * error[k]) & (batch <= batch[k])
        out[k] = us[k] / us[equal].min()
    return out


def speed_error(scene: Scene, found: Mapping[Case, Timed | Failure]) -> pd.DataFrame:
    """One row per case of a task; a case that failed has no numbers."""
    rows = []
    for case, result in found.items():
        if case.task not in TASKS:
            continue
        numbers = [np.nan] * 4
        if isinstance(result, Timed):
            numbers = [*result.us().tolist(), result.error.relative if result.error else np.nan]
        names = ("us_per_sample", "us_p10", "us_p90", "max_rel_error")
        row = {"task": case.task, "scene": scene.name, "engine": case.engine, "route": case.route}
        row |= {"backend": case.backend, "setting": case.setting, "batch": case.batch}
        rows.append(row | dict(zip(names, numbers, strict=True)))
    table = pd.DataFrame(rows)
    table["ratio_to_fastest"] = ratio_to_fastest(table)
    return table


SCALING_COLUMNS = [
    "what", "engine", "route", "backend", "setting", "batch", "legs", "us_per_sample", "us_p10", "us_p90", "peak_mb",
]  # fmt: skip


def scaling(scene: Scene, found: Mapping[Case, Timed | Failure]) -> pd.DataFrame:
    """Time and memory of what takes samples in batches, and of machines of other numbers of legs."""
    rows = []
    for case, result in found.items():
        if isinstance(result, Failure) or (case.task != LEGS and case.task not in TASKS[:3]):
            continue
        legs = dict(case.knobs).get("legs", scene.N)
        which = (case.setting, "") if case.task == LEGS else (case.task, case.setting)
        us, peak = result.us().tolist(), result.peak / 1e6
        rows.append((which[0], case.engine, case.route, case.backend, which[1], case.batch, legs, *us, peak))
    return pd.DataFrame(rows, columns=SCALING_COLUMNS)
