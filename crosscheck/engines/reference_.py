"""Certified truth: body-by-body Newton-Euler in ball arithmetic, every number with a proven radius.

First principles alone.  Inputs are the scene and the trajectory rows, both as exact float64; the quaternion is
normalised exactly; the joint coordinates of the trajectory are not read.  A quantity that moves is a 2-jet
(x, x', x''), differentiated exactly; momenta are differentiated, not rearranged.  The elimination is structured: the
bodies of a leg give everything in terms of the force along the leg, the platform's six equations give these forces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any, ClassVar, NamedTuple

import flint
import numpy as np
from flint import arb, arb_mat

from ...models.scene import Scene
from .. import wrench
from ..balls import (
    Jet,
    Vector,
    apply,
    cross,
    cross_jet,
    dot,
    dot_jet,
    minus,
    over,
    plus,
    sqrt_jet,
    times,
    total,
    vector,
)
from ..engine import DynamicsResult, EngineError, engine_version

FIRST_BITS, MOST_BITS = 128, 8192
BOUND = 1e-20
"""Wanted radius, relative to the largest force or moment of the sample: far below float64, which holds the value."""

LEAST_FORCE = 1e-9
"""What the bound refers to when forces cancel, N."""

MOST_SAMPLES = 1000
SEED = 20160403


class NotCertified(EngineError):
    """No radius below the bound up to the largest precision: the pose is singular, or nearly so."""


# --- One body ---------------------------------------------------------------------------------------------------------


class _Turning(NamedTuple):
    """Angular velocity and acceleration of a frame, and the frame's axes as jets."""

    axes: tuple[Jet, Jet, Jet]
    omega: Vector
    alpha: Vector


def _turning(*axes: Jet) -> _Turning:
    """From the axes of an orthonormal frame: omega = 1/2 sum e x e', alpha = 1/2 sum e x e''."""
    half = arb(1) / 2
    omega = times(half, plus(*(cross(e[0], e[1]) for e in axes)))
    alpha = times(half, plus(*(cross(e[0], e[2]) for e in axes)))
    return _Turning((axes[0], axes[1], axes[2]), omega, alpha)


def _angular_momentum_rate(body: _Turning, J: tuple[arb, arb, arb]) -> Vector:
    """H' of H = sum J_k (omega . e_k) e_k, the angular momentum about the centre of mass."""
    dH = []
    for J_k, e in zip(J, body.axes, strict=True):
        h = J_k * dot(body.omega, e[0])
        dh = J_k * (dot(body.alpha, e[0]) + dot(body.omega, e[1]))
        dH.append(plus(times(dh, e[0]), times(h, e[1])))
    return plus(*dH)


# --- One sample -------------------------------------------------------------------------------------------------------


@dataclass
class _Leg:
    """A leg at one instant: geometry, and what Newton and Euler say of each body before any force acts at the tip."""

    tip: Jet
    r: Vector
    L: Jet
    frame: _Turning
    y_r: Vector
    base_rate: arb
    F_s: Vector
    F_n: Vector
    F_o: Vector
    M_s: Vector
    M_n: Vector
    M_o: Vector
    power: arb

    def reactions(self, a: arb, F_r: Vector) -> dict[str, Vector]:
        """Add the force on the tip: forces pass down the chain, moments grow by their levers."""
        y = self.frame.axes[1][0]
        at_rod = cross(times(a, y), F_r)
        at_hull = cross(times(self.L[0], y), F_r)
        return {
            "F_r": F_r,
            "F_s": minus(self.F_s, F_r),
            "F_n": minus(self.F_n, F_r),
            "F_o": minus(self.F_o, F_r),
            "M_s": minus(self.M_s, at_rod),
            "M_n": minus(self.M_n, at_hull),
            "M_o": minus(self.M_o, at_hull),
        }


class _Sample:
    """The mechanism at one row of a trajectory, at the current precision."""

    def __init__(self, scene: Scene, row: Mapping[str, Sequence[float]]) -> None:
        self.scene = scene
        self.g = vector(scene.gravity)
        C, dC, ddC = (vector(row[n]) for n in ("position", "velocity", "acceleration"))
        self.C: Jet = (C, dC, ddC)
        self.omega, self.alpha = vector(row["angular_velocity"]), vector(row["angular_acceleration"])
        self.R = self._rotation([arb(float(v)) for v in row["quaternion"]])
        self.a = arb(scene.leg.a)
        self.legs = [self._leg(i) for i in range(scene.N)]

    @staticmethod
    def _rotation(q: list[arb]) -> list[Vector]:
        w, x, y, z = q
        n = 2 / (w * w + x * x + y * y + z * z)
        return [
            (1 - n * (y * y + z * z), n * (x * y - w * z), n * (x * z + w * y)),
            (n * (x * y + w * z), 1 - n * (x * x + z * z), n * (y * z - w * x)),
            (n * (x * z - w * y), n * (y * z + w * x), 1 - n * (x * x + y * y)),
        ]

    def _turned(self, p: Vector) -> Jet:
        """A vector fixed in the platform, by r' = omega x r."""
        r = apply(self.R, p)
        dr = cross(self.omega, r)
        return r, dr, plus(cross(self.alpha, r), cross(self.omega, dr))

    def _leg(self, i: int) -> _Leg:
        leg = self.scene.leg
        zero = (arb(0), arb(0), arb(0))
        y_r: Jet = ((arb(0), arb(1), arb(0)), zero, zero)
        r = self._turned(vector(self.scene.platform.pins[i]))
        pin = vector(self.scene.hull.pins[i])
        tip = (minus(plus(self.C[0], r[0]), pin), plus(self.C[1], r[1]), plus(self.C[2], r[2]))

        # The base turns about y_r, the guide about z_n, which is horizontal and square to the leg.
        L = sqrt_jet(dot_jet(tip, tip))
        across = cross_jet(y_r, tip)
        y = over(tip, L)
        z = over(across, sqrt_jet(dot_jet(across, across)))
        frame = _turning(cross_jet(y, z), y, z)
        base = _turning(cross_jet(y_r, z), y_r, z)

        # Rod: its centre of mass is a short of the tip.
        m_s, J_x, J_z = (arb(v) for v in (leg.rod.mass, leg.rod.J_x, leg.rod.J_z))
        rod = tuple(minus(tip[d], times(self.a, y[d])) for d in range(3))
        dH_s = _angular_momentum_rate(frame, (J_x, J_z, J_x))
        F_s = times(m_s, minus(rod[2], self.g))

        # Guide: central inertia from the one about O_n.
        m_n, a_n, J_nx, J_ny = (arb(v) for v in (leg.guide.mass, leg.guide.com, leg.guide.J_x, leg.guide.J_y))
        J_c = J_nx - m_n * a_n * a_n
        guide = tuple(times(a_n, y[d]) for d in range(3))
        dH_n = _angular_momentum_rate(frame, (J_c, J_ny, J_c))
        F_n = plus(times(m_n, minus(guide[2], self.g)), F_s)
        # Moments about the guide's centre of mass: F_n acts at O_n, -F_s and -M_s (here H_s') at the rod's.
        M_n = plus(dH_n, cross(guide[0], F_n), dH_s, cross(minus(rod[0], guide[0]), F_s))

        # Base: its centre of mass does not move.
        m_o, J_o = (arb(leg.base.mass), arb(leg.base.J_z)) if leg.base else (arb(0), arb(0))
        dH_o = _angular_momentum_rate(base, (J_o, J_o, J_o))
        F_o = minus(F_n, times(m_o, self.g))
        M_o = plus(dH_o, M_n)

        power = total(
            m_s * dot(rod[1], minus(rod[2], self.g)),
            m_n * dot(guide[1], minus(guide[2], self.g)),
            dot(frame.omega, plus(dH_s, dH_n)),
            dot(base.omega, dH_o),
        )
        return _Leg(tip, r[0], L, frame, y_r[0], base.omega[1], F_s, F_n, F_o, dH_s, M_n, M_o, power)

    def solve(self) -> dict[str, list]:
        """Forces along the legs from the platform, then every reaction. Raises ZeroDivisionError if none is certain."""
        platform = self.scene.platform
        load = self.scene.load
        force = vector(load.force) if load else vector((0, 0, 0))
        moment = vector(load.moment) if load else vector((0, 0, 0))
        point = self._turned(vector(load.point) if load else vector((0, 0, 0)))

        I_p = [vector(row) for row in platform.inertia]
        columns = [tuple(row[j] for row in self.R) for j in range(3)]  # the platform's axes in the world

        def tensor(v: Vector) -> Vector:
            return apply(self.R, apply(I_p, apply(columns, v)))  # type: ignore[arg-type]

        H = tensor(self.omega)
        dH = plus(tensor(self.alpha), cross(self.omega, H))
        inertial = times(arb(platform.mass), minus(self.C[2], self.g))
        right_F = minus(inertial, force)
        right_M = minus(dH, plus(moment, cross(point[0], force)))

        # Hinges n and o are passive: M_n . z_n = 0 and M_o . y_r = 0 give two components of F_r; along y_n it is free.
        known, along = [], []
        for leg in self.legs:
            x, y, z = (e[0] for e in leg.frame.axes)
            arm_n = cross(z, times(leg.L[0], y))  # (L y x F) . z = F . (z x L y)
            arm_o = cross(leg.y_r, times(leg.L[0], y))
            on_x = dot(leg.M_n, z) / dot(arm_n, x)
            on_z = dot(leg.M_o, leg.y_r) / dot(arm_o, z)
            F_r = plus(times(on_x, x), times(on_z, z))
            known.append(F_r)
            along.append((*y, *cross(leg.r, y)))
            right_F = plus(right_F, F_r)
            right_M = plus(right_M, cross(leg.r, F_r))
        A = arb_mat(6, 6, [-column[j] for j in range(6) for column in along])
        free = A.solve(arb_mat(6, 1, [*right_F, *right_M]))

        out: dict[str, list] = {name: [] for name in ("F", "F_r", "F_s", "F_n", "F_o", "M_s", "M_n", "M_o", "L", "dL")}
        spent = -dot(self.C[1], force) - dot(self.omega, moment) - dot(point[1], force)
        spent = spent + dot(self.C[1], inertial) + dot(self.omega, dH)
        for i, leg in enumerate(self.legs):
            y = leg.frame.axes[1][0]
            reactions = leg.reactions(self.a, plus(known[i], times(free[i, 0], y)))
            for name, value in reactions.items():
                out[name].append(value)
            out["F"].append(dot(reactions["F_s"], y))
            out["L"].append(leg.L[0])
            out["dL"].append(leg.L[1])
            spent = spent + leg.power
        out["power"] = [spent - total(*(F * dL for F, dL in zip(out["F"], out["dL"], strict=True)))]
        return out


def certified(scene: Scene, row: Mapping[str, Sequence[float]], bound: float = BOUND) -> dict[str, list]:
    """Balls of every force, moment, leg length and rate of one row, and the power balance.

    Parameters
    ----------
    scene : Scene
        N = 6.
    row : position, quaternion (scalar first, any length), velocity, angular_velocity, acceleration,
        angular_acceleration of the platform: exact float64, world axes, SI units.
    bound : wanted radius relative to the largest force of the sample (moments: times the longest leg).

    Returns
    -------
    dict
        ``F, L, dL``: six balls; ``F_r, F_s, F_n, F_o, M_s, M_n, M_o``: six vectors of balls, world axes; ``power``:
        one ball, d(T + V)/dt minus the power of load and actuators, which contains zero.

    Raises
    ------
    NotCertified
        The radius stays above the bound at 8192 bits.
    """
    before = flint.ctx.prec
    bits = FIRST_BITS
    try:
        while bits <= MOST_BITS:
            flint.ctx.prec = bits
            try:
                out = _Sample(scene, row).solve()
            except ZeroDivisionError:
                bits *= 2
                continue
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
    return value, float(distance.abs_upper()) * (1 + 2**-50)


def chosen_samples(nt: int, condition: np.ndarray) -> np.ndarray:
    """All samples up to 1000; beyond, 1000 seeded ones and the worst conditioned."""
    if nt <= MOST_SAMPLES:
        return np.arange(nt)
    picked = np.random.default_rng(SEED).choice(nt, MOST_SAMPLES, replace=False)
    return np.unique(np.append(picked, np.argmax(condition)))


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
        samples = chosen_samples(len(trajectory.t), trajectory.condition)
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
            reactions=self._by_joint(value),
            L=value["L"],
            dL=value["dL"],
            radius={"F": radius["F"], "reactions": self._by_joint(radius), "L": radius["L"], "dL": radius["dL"]},
            seconds=perf_counter() - start,
        )

    def _by_joint(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        zero = np.zeros_like(values["F_r"])
        parts = [(values[j.moment] if j.moment else zero, values[j.force], j.leg - 1) for j in self.scene.joints]
        return np.stack([wrench.from_parts(m[:, leg], f[:, leg]) for m, f, leg in parts], axis=1)


ENGINE = ReferenceEngine
