"""What the audit of the paper's text is made of: rows of the table, cases that they are measured on, tolerances.

A row states one equation, names the function that holds it, and measures it against what does not come from it: forces
and moments of the certified truth, or the pose itself.  A row of a misprint measures two readings, the correct one and
the printed one.  `audit_equations`, `audit_planar`, `audit_misprints` and `audit_text` hold the rows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from . import samples, stewart
from .stewart import Parameters, PlanarParameters, PlatformMotion, Vector

Kind = Literal["equation", "misprint", "control", "text"]


class Tolerance(NamedTuple):
    """Largest residual of a correct reading over its scale, its name, and why it has this value."""

    name: str
    value: float
    why: str


GEOMETRY = Tolerance(
    "geometry",
    2e-15,
    "lengths of a metre, direction cosines and inertias, some ten roundings of 1e-16: measured below 3e-16",
)
LOADS = Tolerance(
    "loads",
    1e-14,
    "sums of some ten forces or moments, no solve: measured below 5e-16; a mass off by 1e-6 of itself lies at 1e-8",
)

MARGIN = 1e3
"""A misprint shows when its printed reading misses by this many tolerances of the correct one."""


class Case(NamedTuple):
    """A mechanism, a motion of nt samples, and what is known of them without the formulas. SI units, world axes.

    ``r`` (nt, N, 3): levers C_p O_r; ``axes`` (nt, N, 3, 3): rows x_n, y_n, z_n of each guide, from the directions
    of the legs; ``inertia`` (nt, N, 3): J_q, J_y, m_q of guide and rod put together body by body; ``principal``:
    principal moments (3,) of the platform and rows x_p, y_p, z_p (nt, 3, 3); ``truth``: certified F, L, dL (nt, N) and
    F_r, F_s, F_n, F_o, M_s, M_n, M_o (nt, N, 3), as far as the mechanism has them.
    """

    name: str
    P: Parameters | PlanarParameters
    motion: PlatformMotion
    r: np.ndarray
    axes: np.ndarray
    inertia: np.ndarray
    principal: tuple[np.ndarray, np.ndarray]
    truth: Mapping[str, np.ndarray]

    @property
    def components(self) -> PlatformMotion:
        """The motion as the formulas take it: vectors are tuples of arrays (nt,)."""
        (_, motion), *_ = samples.blocks(self.motion)
        return motion

    @property
    def force(self) -> float:
        """Scale of forces [N]: the largest certified one."""
        return max(float(np.linalg.norm(v, axis=2).max()) for name, v in self.truth.items() if name in _FORCES)

    @property
    def moment(self) -> float:
        """Scale of moments [N m]: the largest force times the longest leg."""
        return self.force * float(self.truth["L"].max())

    def along(self, axis: int, vectors: np.ndarray) -> np.ndarray:
        """Components (nt, N) of vectors (nt, N, 3) along x_n, y_n or z_n of each leg: axis 0, 1 or 2."""
        return np.sum(vectors * self.axes[:, :, axis], axis=2)


_FORCES = ("F_r", "F_s", "F_n", "F_o")

Measure = Callable[[Case], float]


class Row(NamedTuple):
    """One row of the table.

    ``key``: its name, unique; ``equation``: the number that it concerns, if any; ``where``: functions of this package
    that hold it, as `module.function`; ``scenes``: cases it is measured on; ``residual``: miss of the correct reading
    over its scale; ``printed``: miss of the other reading (misprints, controls); ``refuses``: cases on which the
    function must raise ValueError; ``prints``, ``correct``: the two readings in words; ``scan``: whether the misprint
    is probably damage of the scanned copy that was read, and not in the paper.
    """

    key: str
    kind: Kind
    equation: str
    states: str
    where: tuple[str, ...] = ()
    scenes: tuple[str, ...] = ()
    residual: Measure | None = None
    tolerance: Tolerance | None = None
    printed: Measure | None = None
    refuses: tuple[str, ...] = ()
    prints: str = ""
    correct: str = ""
    scan: bool = False


def equation(key: str, states: str, where: str, scenes: tuple[str, ...], residual: Measure, **more: Any) -> Row:
    """Row of a numbered equation; ``where``: names in `stewart`, separated by spaces."""
    return Row(key, "equation", key, states, _names(where), scenes, residual, more.pop("tolerance", LOADS), **more)


def _two_readings(
    kind: Kind,
    key: str,
    number: str,
    states: str,
    where: str,
    scenes: tuple[str, ...],
    readings: tuple[Measure, Measure],
    **more: Any,
) -> Row:
    correct, other = readings
    return Row(key, kind, number, states, _names(where), scenes, correct, more.pop("tolerance", LOADS), other, **more)


def misprint(*row: Any, **more: Any) -> Row:
    """Row of a misprint: key, number, states, where, scenes and the readings, the correct and the printed one."""
    return _two_readings("misprint", *row, **more)


def control(*row: Any, **more: Any) -> Row:
    """Row of a deliberate mistake that must show: as `misprint`, the readings being the correct and the wrong one."""
    return _two_readings("control", *row, **more)


def text(key: str, number: str, states: str, where: str, prints: str, correct: str, **more: Any) -> Row:
    """Row of a misprint that changes no number."""
    return Row(key, "text", number, states, _names(where), prints=prints, correct=correct, **more)


def _names(where: str) -> tuple[str, ...]:
    return tuple(f"stewart.{name}" for name in where.split())


# --- Arrays and components --------------------------------------------------------------------------------------------


def per_leg(a: np.ndarray) -> list[Any]:
    """Arrays (nt, N) or (nt, N, 3) as one scalar or vector of arrays (nt,) per leg."""
    if a.ndim == 2:
        return list(a.T)
    return [tuple(np.ascontiguousarray(a[:, i, j]) for j in range(3)) for i in range(a.shape[1])]


def stacked(legs: Sequence[Any]) -> np.ndarray:
    """A scalar or a vector per leg as an array (nt, N) or (nt, N, 3)."""
    columns = [np.broadcast_arrays(*v) if isinstance(v, tuple) else v for v in legs]
    return np.moveaxis(np.array(columns), -1, 0)


def miss(got: Any, want: Any, scale: float) -> float:
    """Largest |got - want| over scale; vectors along the third axis by their length. NaN if any is."""
    d = np.asarray(got) - np.asarray(want)
    return float(np.max(np.linalg.norm(d, axis=2) if d.ndim == 3 else np.abs(d))) / scale


def largest(values: Any) -> float:
    """Largest of some numbers; NaN if any is."""
    return float(np.max(list(values)))


# --- States of the legs by the formulas -------------------------------------------------------------------------------


class LegAt(NamedTuple):
    """Leg i of a case by the formulas: parameters, state, hinge rates, printed loads, hull pin."""

    i: int
    leg: stewart.Leg
    k: stewart.LegState
    h: stewart.HingeRates
    loads: stewart.Loads
    O: Vector


def spatial(case: Case) -> Parameters:
    """Parameters of a spatial case."""
    assert isinstance(case.P, Parameters)
    return case.P


def planar(case: Case) -> PlanarParameters:
    """Parameters of a planar case."""
    assert isinstance(case.P, PlanarParameters)
    return case.P


def legs(case: Case) -> list[LegAt]:
    """Every leg of a spatial case."""
    P, motion = spatial(case), case.components
    found = []
    for i, (p, O) in enumerate(zip(P.p, P.O, strict=True)):
        k = stewart.leg_kinematics(P.leg, p, O, motion, np.sqrt)
        h = stewart.hinge_rates(k)
        found.append(LegAt(i, P.leg, k, h, stewart.leg_loads_printed(P.leg, k, h, P.g), O))
    return found


def planar_legs(case: Case, motion: PlatformMotion | None = None) -> list[stewart.PlanarLegState]:
    """Every leg of a planar case, by another motion if one is given."""
    P, motion = planar(case), motion or case.components
    return [stewart.planar_leg_kinematics(P.leg, p, O, motion, np.sqrt) for p, O in zip(P.p, P.O, strict=True)]
