"""Certified truth: body-by-body Newton-Euler in ball arithmetic, every number with a proven radius.

First principles alone.  Inputs are the scene and the trajectory rows, both as exact float64; the quaternion is
normalised exactly; the joint coordinates of the trajectory are not read.  The mechanics is in `newton_euler`; here the
precision is raised until every radius is small, and balls become float64 with a radius that covers the rounding.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import Any, ClassVar

import flint
import numpy as np
from flint import arb

from ...models.scene import Scene
from .. import wrench
from ..chosen import chosen_samples
from ..engine import DynamicsResult, EngineError, by_joint, engine_version
from ..newton_euler import Infeasible, Sample

FIRST_BITS, MOST_BITS = 128, 8192
BOUND = 1e-20
"""Wanted radius, relative to the largest force or moment of the sample: far below float64, which holds the value."""

LEAST_FORCE = 1e-9
"""What the bound refers to when forces cancel, N."""


class NotCertified(EngineError):
    """No radius below the bound up to the largest precision (a singular pose), or no forces at all."""


def certified(scene: Scene, row: Mapping[str, Sequence[float]], bound: float = BOUND) -> dict[str, list]:
    """Balls of every force, moment, leg length and rate of one row, and the power balance.

    Parameters
    ----------
    scene : Scene
        N = 6; planar: 3, or 2 for a point mass.
    row : position, quaternion (scalar first, any length), velocity, angular_velocity, acceleration,
        angular_acceleration of the platform: exact float64, world axes, SI units.
    bound : wanted radius relative to the largest force of the sample (moments: times the longest leg).

    Returns
    -------
    dict
        ``F, L, dL``: a ball per leg; ``F_r, F_s, F_n, F_o, M_s, M_n, M_o``: a vector per leg, world axes; ``F_hull,
        M_hull``: one vector; ``power``:
        one ball, d(T + V)/dt minus the power of load and actuators, which contains zero.

    Raises
    ------
    NotCertified
        The radius stays above the bound at 8192 bits, or the motion is infeasible.
    """
    before = flint.ctx.prec
    bits = FIRST_BITS
    try:
        while bits <= MOST_BITS:
            flint.ctx.prec = bits
            try:
                out = Sample(scene, row).solve()
            except ZeroDivisionError:
                bits *= 2
                continue
            except Infeasible as e:
                raise NotCertified(f"reference: {e}") from None
            balls = {
                name: [x for v in values for x in (v if isinstance(v, tuple) else (v,))] for name, values in out.items()
            }
            forces = [x for name in out if name.startswith("F") for x in balls[name]]
            moments = [x for name in out if name.startswith("M") for x in balls[name]]
            scale = max(LEAST_FORCE, *(float(abs(x)) for x in forces))
            longest = max(float(x) for x in balls["L"])
            small_F = all(x.is_finite() and float(x.rad()) <= bound * scale for x in forces)
            small_M = all(x.is_finite() and float(x.rad()) <= bound * scale * longest for x in moments)
            if small_F and small_M:
                if not out["power"][0].contains(0):
                    raise NotCertified(
                        f"reference: the power balance is {out['power'][0]}, expected a ball around zero"
                    )
                return out
            bits *= 2
    finally:
        flint.ctx.prec = before
    raise NotCertified(f"reference: no radius below {bound:g} of the largest force at {MOST_BITS} bits: singular pose")


def _to_float(x: arb) -> tuple[float, float]:
    """Nearest float64 and a proven bound of its distance to the exact value, the rounding included."""
    value = float(x.mid())
    distance = abs(x - arb(value))
    return value, 0.0 if distance == 0 else math.nextafter(float(distance.abs_upper()), math.inf)


class ReferenceEngine:
    """Certified truth as an engine: `values` are the nearest float64, `radius` bounds their distance to the truth."""

    name: ClassVar[str] = "reference"
    package: ClassVar[str] = "python-flint"
    route: ClassVar[str] = "certified"
    checks: ClassVar[tuple[str, ...]] = ()

    def __init__(self, scene: Scene, models: Mapping[str, str] | None = None) -> None:
        self.scene = scene

    def inverse_dynamics(self, trajectory: Any) -> DynamicsResult:
        """Certified driving forces and reactions. Raises NotCertified."""
        start = perf_counter()
        samples = chosen_samples(len(trajectory.t), trajectory.condition, trajectory.sin_q_n)
        names = ("position", "quaternion", "velocity", "angular_velocity", "acceleration", "angular_acceleration")
        rows = [getattr(trajectory, name)[samples].tolist() for name in names]
        pairs: dict[str, list] = {}
        for sample, *row in zip(samples, *rows, strict=True):
            try:
                out = certified(self.scene, dict(zip(names, row, strict=True)))
            except NotCertified as e:
                raise NotCertified(f"sample {sample}: {e}") from None
            for name, values in out.items():
                pairs.setdefault(name, []).append(
                    [[_to_float(x) for x in v] if isinstance(v, tuple) else _to_float(v) for v in values]
                )
        value = {name: np.array(p)[..., 0] for name, p in pairs.items()}
        radius = {name: np.array(p)[..., 1] for name, p in pairs.items()}
        return DynamicsResult(
            engine=self.name,
            version=engine_version(type(self)) or "",
            route=self.route,
            setting=f"{FIRST_BITS} bits and more, radius {BOUND:g}",
            samples=samples,
            F=value["F"],
            reactions=by_joint(self.scene, value),
            L=value["L"],
            dL=value["dL"],
            hull=wrench.from_parts(value["M_hull"], value["F_hull"])[:, 0],
            radius={
                "F": radius["F"],
                "reactions": by_joint(self.scene, radius),
                "L": radius["L"],
                "dL": radius["dL"],
                "hull": wrench.from_parts(radius["M_hull"], radius["F_hull"])[:, 0],
            },
            seconds=perf_counter() - start,
        )


ENGINE = ReferenceEngine
