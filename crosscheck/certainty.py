"""Certified answers at one point, and how far half-ulp changes of its inputs move them: float64 can do no better.

The sensitivity is of first order: every number of the scene and of the motion, but for zeros, is made one ulp larger on
its own, and half of what the exact answer changes by is added up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import flint
import numpy as np
from flint import arb, arb_mat

from ..analytic.solve import SingularPose, longest_lever
from ..models.scene import Scene
from ..models.tables import Table
from .conditioning import conditioning
from .engine import HULL, DynamicsResult
from .engines.reference_ import COLUMNS, NotCertified, ReferenceEngine, accelerated, certified, certified_forward
from .hard import Point
from .newton_euler import Infeasible, Sample
from .quaternions import rotation

BITS = 512
"""Of the exact answers to moved inputs: they differ in the 16th digit, or in none that a singular pose leaves."""

PART = 2.0**-128
"""Of an ulp: what is of second order vanishes.

Where a platform stands stiff on a steep leg, the equations that an ulp leaves behind are off by more than the answer.
"""

MACHINE = ("gravity", "leg", "platform", "hull", "load")
"""What of a scene is an input beside the row."""


@dataclass(frozen=True)
class Certain:
    """Truth at one point.

    ``result``: one sample, as the reference gives it; of the forward problem with ``platform``.  ``sensitivity``: by
    quantity, of the leg where it is largest, in the quantity's unit.  ``condition``: of the linear equations that stand
    at the end, moments over the longest lever.
    """

    result: DynamicsResult
    sensitivity: Mapping[str, float]
    condition: float


def larger(x: float) -> float:
    """The next float64."""
    return math.nextafter(x, math.inf)


def hardly_larger(x: float) -> arb:
    """By a part of what the next float64 is larger by."""
    return arb(x) + (arb(larger(x)) - arb(x)) * PART


def moved(x: Any, by: Callable[[float], Any] = larger) -> Iterator[Any]:
    """Copies of nested tables and tuples, in each of which one number is another one; zeros stay."""
    if isinstance(x, float) and x != 0.0:
        yield by(x)
    elif isinstance(x, tuple):
        for i, part in enumerate(x):
            for new in moved(part, by):
                parts = (*x[:i], new, *x[i + 1 :])
                yield type(x)(*parts) if hasattr(x, "_fields") else parts
    elif isinstance(x, Table):
        for name in MACHINE if isinstance(x, Scene) else type(x).model_fields:
            for new in moved(getattr(x, name), by):
                yield x.model_copy(update={name: new})


def _sensitivity(exact: Mapping[str, list], others: Iterable[Mapping[str, list]]) -> dict[str, float]:
    """Half of the summed changes from an answer to others, component by component; then the longest vector."""
    total = {name: np.zeros((len(values), len(_columns(values)[0]))) for name, values in exact.items()}
    for other in others:
        for name, sums in total.items():
            before, after = _columns(exact[name]), _columns(other[name])
            sums += [
                [abs(float(b - a)) for a, b in zip(*pair, strict=True)] for pair in zip(before, after, strict=True)
            ]
    return {name: 0.5 * float(np.linalg.norm(x, axis=1).max()) for name, x in total.items()}


def _columns(values: Sequence[Any]) -> list[Sequence[arb]]:
    return [v if isinstance(v, tuple) else (v,) for v in values]


def condition_of_forces(point: Point) -> float:
    """Of the platform's equations for the driving forces; infinite in a singular pose, NaN unless N fits.

    NaN, too, where a leg is too short for joint coordinates: that is no matter of what is certain.
    """
    R = rotation(np.array([point.row.quaternion]))
    try:
        with np.errstate(all="ignore"):
            return float(conditioning(point.scene, np.array([point.row.position]), R, regular=False).condition[0])
    except SingularPose:
        return float("nan")


def certain_inverse(point: Point) -> Certain:
    """Driving forces and reactions of the motion. Raises NotCertified."""
    scene = point.scene
    if scene.nv != scene.na + scene.nc:
        raise NotCertified(f"reference: {scene.N} legs for {scene.platform_equations} equations: no forces, or many")
    found = certified(scene, point.row._asdict())
    with flint.ctx.workprec(BITS):
        try:
            exact, *others = (Sample(p.scene, p.row._asdict()).solve() for p in (point, *moved(point)))
        except (ZeroDivisionError, Infeasible) as e:
            raise NotCertified(f"reference: an ulp away from the point there are no forces ({e})") from None
        sensitivity = _sensitivity({name: exact[name] for name in (*scene.quantities, *HULL)}, others)
    return Certain(ReferenceEngine(scene).result([found]), sensitivity, condition_of_forces(point))


def certain_forward(point: Point) -> Certain:
    """Accelerations under the point's driving forces, and the reactions then. Raises NotCertified."""
    scene, F = point.scene, point.forces
    found, matrix = certified_forward(scene, point.row._asdict(), F)
    columns = COLUMNS[scene.freedom]
    with flint.ctx.workprec(BITS):
        six = [arb(x.mid()) for v in ("a", "alpha") for x in found[v][0]]

        def sample(at: Point, x: Sequence[arb]) -> Sample:
            return accelerated(at.scene, at.row._asdict(), x)

        def answer(at: Point, F: Sequence[Any], x: Sequence[arb]) -> dict[str, list]:
            made = sample(at, x)
            return {**made.under([arb(f) for f in F]), "a": [made.C[2]], "alpha": [made.alpha]}

        places, forces = moved(point, hardly_larger), moved(F, hardly_larger)
        inputs = [*((other, F) for other in places), *((point, other) for other in forces)]
        still = sample(point, six).left_over([arb(f) for f in F])
        # What the moved equations leave at the accelerations of the point is undone by a step of the accelerations.
        left = [sample(at, six).left_over([arb(f) for f in G]) for at, G in inputs]
        steps = matrix.solve(arb_mat([[s - r[i] for r in left] for i, s in enumerate(still)])).tolist()
        others = []
        for k, (at, G) in enumerate(inputs):
            step = dict.fromkeys(range(6), arb(0)) | {j: row[k] for j, row in zip(columns, steps, strict=True)}
            others.append(answer(at, G, [x + step[j] for j, x in enumerate(six)]))
        exact = answer(point, F, six)
        sensitivity = _sensitivity({name: exact[name] for name in (*scene.quantities, *HULL, "a", "alpha")}, others)
        sensitivity = {name: x / PART for name, x in sensitivity.items()}
    units = np.where(np.array(columns) < 3, 1.0, longest_lever(scene.pins))
    A = np.array([[float(x) for x in row] for row in matrix.tolist()]) / np.outer(units, units)
    return Certain(ReferenceEngine(scene).result([found]), sensitivity, float(np.linalg.cond(A)))
