"""Inverse dynamics of one engine, block by block: its answers where truth is, its own checks at every sample.

An engine never holds all reactions of a long trajectory, and nobody else does: what is left of a block are the samples
that are compared with the truth, and of every other one the largest gap of a loop and residual of a body.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..models.scene import Scene
from .balance import balance
from .chosen import chosen_samples
from .engine import DynamicsResult, Engine, EngineError, require_complete
from .trajectory import Trajectory


class Worst(NamedTuple):
    """Errors of some columns (legs or bodies) at every sample: the largest one and its column, the mean square, (nt,).

    ``columns``: what the columns are called.
    """

    error: np.ndarray
    column: np.ndarray
    square: np.ndarray
    columns: tuple[str, ...]

    @classmethod
    def of(cls, errors: np.ndarray, columns: Sequence[str]) -> Worst:
        """From errors (nt, columns). A NaN is larger than any number."""
        return cls(errors.max(axis=1), errors.argmax(axis=1), np.mean(errors**2, axis=1), tuple(columns))

    @classmethod
    def joined(cls, blocks: Sequence[Worst]) -> Worst:
        """Of samples that follow each other."""
        error, column, square = (np.concatenate(x) for x in zip(*(b[:3] for b in blocks), strict=True))
        return cls(error, column, square, blocks[0].columns)


def checks(
    scene: Scene, engine: type[Engine], trajectory: Trajectory, result: DynamicsResult, length: float
) -> dict[str, Worst]:
    """The checks that an engine declares, from its gaps and reactions at each sample; `length` as in `balance`."""
    found = {}
    for name in engine.checks:
        if name == "balance":
            residual = balance(scene, trajectory, result.reactions, length)
            found[name] = Worst.of(np.stack(list(residual.values()), axis=1), list(residual))
        else:
            found[name] = Worst.of(np.linalg.norm(result.loops[name], axis=2), [f"leg {i}" for i in scene.legs])
    return found


def longest_leg(scene: Scene, trajectory: Trajectory) -> float:
    """Longest leg [m] by the joint coordinates."""
    return max(float(trajectory.q[f"s{i}"].max()) for i in scene.legs) + scene.leg.a


def inverse_dynamics(
    name: str, engine: type[Engine], scene: Scene, models: Mapping[str, str] | None, trajectory: Trajectory
) -> DynamicsResult:
    """What an engine says at the samples that are compared, and `checks` at all. Raises EngineError."""
    made = engine(scene, models)
    chosen = chosen_samples(len(trajectory.t), trajectory.condition, trajectory.sin_q_n)
    length = longest_leg(scene, trajectory)
    parts: list[DynamicsResult] = []
    evaluated = 0
    for block in trajectory.blocks():
        try:
            result = made.inverse_dynamics(block)
            require_complete(name, engine, engine.route, scene, block, result)
        except EngineError as e:
            raise EngineError(f"{e} (counted from sample {evaluated})" if evaluated else str(e)) from None
        kept = chosen[(chosen >= evaluated) & (chosen < evaluated + len(block.t))] - evaluated
        found = checks(scene, engine, block, result, length)
        some = {key: getattr(result, key)[kept] for key in ("F", "reactions", "L", "dL")}
        parts.append(replace(result, samples=kept + evaluated, loops={}, checks=found, **some))
        evaluated += len(block.t)
    return _joined(parts, evaluated)


def _joined(parts: Sequence[DynamicsResult], evaluated: int) -> DynamicsResult:
    arrays = {key: np.concatenate([getattr(p, key) for p in parts]) for key in ("samples", "F", "reactions", "L", "dL")}
    found = {name: Worst.joined([p.checks[name] for p in parts]) for name in parts[0].checks}
    seconds = sum(p.seconds for p in parts)
    return replace(parts[0], checks=found, evaluated=evaluated, seconds=seconds, **arrays)
