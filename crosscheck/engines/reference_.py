"""Certified truth: body-by-body Newton-Euler in ball arithmetic, every number with a proven radius.

First principles alone.  Inputs are the scene and the trajectory rows, both as exact float64; the quaternion is
normalised exactly; the joint coordinates of the trajectory are not read.  The mechanics is in `newton_euler`; here the
precision is raised until every radius is small, and balls become float64 with a radius that covers the rounding.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any, ClassVar

import flint
import numpy as np
from flint import arb, arb_mat

from ...models.scene import Scene
from .. import wrench
from ..chosen import chosen_samples
from ..engine import DynamicsResult, EngineError, by_joint, engine_version
from ..newton_euler import Infeasible, Sample

PRECISIONS = tuple(2**k for k in range(7, 14))
"""Tried in turn [bits]."""

BOUND = 1e-20
"""Wanted radius, relative to the largest force or moment of the sample: far below float64, which holds the value."""

COLUMNS = {"spatial": (0, 1, 2, 3, 4, 5), "planar": (0, 1, 5), "point": (0, 1)}
"""Components of ddC_p and dw_p that a platform has."""

LEAST_FORCE = 1e-9
"""What the bound refers to when forces cancel [N], and accelerations [SI units]."""


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
    for bits in PRECISIONS:
        with flint.ctx.workprec(bits):
            try:
                out = Sample(scene, row).solve()
            except ZeroDivisionError:
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
    raise NotCertified(
        f"reference: no radius below {bound:g} of the largest force at {PRECISIONS[-1]} bits: singular pose"
    )


def certified_forward(
    scene: Scene, row: Mapping[str, Sequence[float]], F: Sequence[float], bound: float = BOUND
) -> tuple[dict[str, list], arb_mat]:
    """Balls of the platform's accelerations under driving forces (N,) [N], of every reaction then, and their matrix.

    The platform's equations are affine in its accelerations: at zero and at six units they give a linear system, which
    is regular in parallel singularities.  Parameters and errors as `certified`; any N; accelerations are not read.

    Returns
    -------
    dict
        As `certified`, with ``a, alpha``, one vector each, in place of ``power``.
    matrix
        Of the accelerations that the platform has, `Scene.platform_equations`.
    """
    columns = COLUMNS[scene.freedom]
    for bits in PRECISIONS:
        with flint.ctx.workprec(bits):
            given = [arb(f) for f in F]
            try:
                still = _left_over(scene, row, given, [0.0] * 6)
                units = [_left_over(scene, row, given, [float(j == k) for j in range(6)]) for k in columns]
                A = arb_mat([[unit[i] - still[i] for unit in units] for i in range(len(columns))])
                found = [x[0] for x in A.solve(arb_mat([[-b] for b in still])).tolist()]
            except ZeroDivisionError:
                continue
            largest = max(LEAST_FORCE, *(float(abs(x)) for x in found))
            if all(x.is_finite() and float(x.rad()) <= bound * largest for x in found):
                six = dict.fromkeys(range(6), arb(0)) | dict(zip(columns, found, strict=True))
                sample = accelerated(scene, row, list(six.values()))
                return {**sample.under(given), "a": [sample.C[2]], "alpha": [sample.alpha]}, A
    raise NotCertified(f"reference: no accelerations within {bound:g} at {PRECISIONS[-1]} bits: no mass, or no leg")


def accelerated(scene: Scene, row: Mapping[str, Sequence[float]], six: Sequence[Any]) -> Sample:
    """The mechanism at a row with other accelerations ddC_p, dw_p, floats or balls."""
    return Sample(scene, {**row, "acceleration": six[:3], "angular_acceleration": six[3:]})


def _left_over(scene: Scene, row: Mapping[str, Sequence[float]], F: Sequence[arb], six: Sequence[Any]) -> list[arb]:
    return accelerated(scene, row, six).left_over(F)


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
        found = []
        for sample, *row in zip(samples, *rows, strict=True):
            try:
                found.append(certified(self.scene, dict(zip(names, row, strict=True))))
            except NotCertified as e:
                raise NotCertified(f"sample {sample}: {e}") from None
        return replace(self.result(found), samples=samples, seconds=perf_counter() - start)

    def result(self, found: Sequence[Mapping[str, list]]) -> DynamicsResult:
        """What `certified` or `certified_forward` found, sample by sample, as float64 with radii."""
        pairs: dict[str, list] = {}
        for out in found:
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
            setting=f"{PRECISIONS[0]} bits and more, radius {BOUND:g}",
            samples=np.arange(len(found)),
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
            platform=np.hstack([value["a"][:, 0], value["alpha"][:, 0]]) if "a" in value else None,
        )


ENGINE = ReferenceEngine
