"""Body-by-body Newton-Euler of one sample in ball arithmetic, from first principles: the mechanics of the reference.

A quantity that moves is a 2-jet (x, x', x''), differentiated exactly; momenta are differentiated, not rearranged.  The
elimination is structured: the bodies of a leg give everything in terms of the force along the leg, the platform's six
equations give these forces.  No formula of the paper, no joint coordinates, no trajectory.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from flint import arb, arb_mat

from ..models.scene import Scene
from .balls import (
    Jet,
    Turning,
    Vector,
    angular_momentum_rate,
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
    turning,
    vector,
)
from .tolerance import FEASIBLE


@dataclass
class _Leg:
    """A leg at one instant: geometry, and what Newton and Euler say of each body before any force acts at the tip."""

    r: Vector
    L: Jet
    frame: Turning
    y_r: Vector
    F_s: Vector
    F_n: Vector
    F_o: Vector
    M_s: Vector
    M_n: Vector
    M_o: Vector
    power: arb
    bodies: list[tuple[arb, Vector, Vector, Vector]]
    """Mass, centre of mass and its acceleration (from the hull pin), rate of the angular momentum about it."""

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


class _Equations(NamedTuple):
    """The platform's six equations, of which ``rows`` count: right - sum(-along u) = 0.

    ``known``: F_r of each leg without its component u along the leg; ``along``: what a unit of u adds to the equations;
    ``inertial``: u + F; ``spent``: power that the platform takes, less that of the load.
    """

    rows: tuple[int, ...]
    right: tuple[arb, ...]
    known: list[Vector]
    along: list[tuple[arb, ...]]
    inertial: list[arb]
    spent: arb


class Sample:
    """The mechanism at one row of a trajectory, at the current precision."""

    def __init__(self, scene: Scene, row: Mapping[str, Sequence[float]]) -> None:
        self.scene = scene
        self.g = vector(scene.gravity)
        C, dC, ddC = (vector(row[n]) for n in ("position", "velocity", "acceleration"))
        self.C: Jet = (C, dC, ddC)
        self.omega, self.alpha = vector(row["angular_velocity"]), vector(row["angular_acceleration"])
        self.R = self._rotation([arb(v) for v in row["quaternion"]])
        self.a = arb(scene.leg.a)
        self.thin = scene.leg.base is None and scene.leg.guide.J_y == 0.0 == scene.leg.rod.J_z
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
        r = self._turned(vector(self.scene.pins[i]))
        pin = vector(self.scene.hull.pins[i])
        tip = (minus(plus(self.C[0], r[0]), pin), plus(self.C[1], r[1]), plus(self.C[2], r[2]))

        # The base turns about y_r, the guide about z_n, horizontal and square to the leg; in a plane about z_r. Without
        # inertia about y_r and its own axis no moment can be across a leg: any axes square to it will do.
        L = sqrt_jet(dot_jet(tip, tip))
        y = over(tip, L)
        if self.scene.topology == "planar":
            z: Jet = ((arb(0), arb(0), arb(1)), zero, zero)
        else:
            upright = self.thin and abs(float(tip[0][0])) < abs(float(tip[0][1]))
            across = cross_jet(((arb(1), arb(0), arb(0)), zero, zero) if upright else y_r, tip)
            z = over(across, sqrt_jet(dot_jet(across, across)))
        frame = turning(cross_jet(y, z), y, z)

        # Rod: its centre of mass is a short of the tip.
        m_s, J_x, J_z = (arb(v) for v in (leg.rod.mass, leg.rod.J_x, leg.rod.J_z))
        rod = tuple(minus(tip[d], times(self.a, y[d])) for d in range(3))
        dH_s = angular_momentum_rate(frame, (J_x, J_z, J_x))
        F_s = times(m_s, minus(rod[2], self.g))

        # Guide: central inertia from the one about O_n.
        m_n, a_n, J_nx, J_ny = (arb(v) for v in (leg.guide.mass, leg.guide.com, leg.guide.J_x, leg.guide.J_y))
        J_c = J_nx - m_n * a_n * a_n
        guide = tuple(times(a_n, y[d]) for d in range(3))
        dH_n = angular_momentum_rate(frame, (J_c, J_ny, J_c))
        F_n = plus(times(m_n, minus(guide[2], self.g)), F_s)
        # Moments about the guide's centre of mass: F_n acts at O_n, -F_s and -M_s (here H_s') at the rod's.
        M_n = plus(dH_n, cross(guide[0], F_n), dH_s, cross(minus(rod[0], guide[0]), F_s))

        power = total(
            m_s * dot(rod[1], minus(rod[2], self.g)),
            m_n * dot(guide[1], minus(guide[2], self.g)),
            dot(frame.omega, plus(dH_s, dH_n)),
        )

        # Base: its centre of mass does not move.
        F_o, M_o = F_n, M_n
        bodies = [(m_s, rod[0], rod[2], dH_s), (m_n, guide[0], guide[2], dH_n)]
        if leg.base:
            base = turning(cross_jet(y_r, z), y_r, z)
            J_o = arb(leg.base.J_z)
            dH_o = angular_momentum_rate(base, (J_o, J_o, J_o))
            F_o = minus(F_n, times(arb(leg.base.mass), self.g))
            M_o = plus(dH_o, M_n)
            power = power + dot(base.omega, dH_o)
            bodies.append((arb(leg.base.mass), zero, zero, dH_o))
        return _Leg(r[0], L, frame, y_r[0], F_s, F_n, F_o, dH_s, M_n, M_o, power, bodies)

    def _platform(self) -> tuple[Vector, Vector, arb]:
        """What the legs must exert on the platform (force, moment about C_p), and the power that takes."""
        platform, load = self.scene.platform, self.scene.load
        force = vector(load.force) if load else vector((0, 0, 0))
        moment = vector(load.moment) if load else vector((0, 0, 0))
        point = self._turned(vector(load.point) if load else vector((0, 0, 0)))

        I_p = [vector(row) for row in platform.tensor]
        columns = [(self.R[0][j], self.R[1][j], self.R[2][j]) for j in range(3)]  # the platform's axes in the world

        def tensor(v: Vector) -> Vector:
            return apply(self.R, apply(I_p, apply(columns, v)))

        H = tensor(self.omega)
        dH = plus(tensor(self.alpha), cross(self.omega, H))
        inertial = times(arb(platform.mass), minus(self.C[2], self.g))
        spent = dot(self.C[1], minus(inertial, force)) + dot(self.omega, minus(dH, moment)) - dot(point[1], force)
        return minus(inertial, force), minus(dH, plus(moment, cross(point[0], force))), spent

    def _on_hull(self) -> tuple[Vector, Vector]:
        """Force and moment on the hull, about the mean of its pins: weight and load less the rate of momentum."""
        pins = [vector(pin) for pin in self.scene.hull.pins]
        center = times(1 / arb(len(pins)), plus(*pins))
        at_platform, about_platform, _ = self._platform()  # weight and load are in it
        force, moment = at_platform, plus(about_platform, cross(minus(self.C[0], center), at_platform))
        for leg, pin in zip(self.legs, pins, strict=True):
            for mass, com, acceleration, dH in leg.bodies:
                inertial = times(mass, minus(acceleration, self.g))
                force = plus(force, inertial)
                moment = plus(moment, dH, cross(plus(minus(pin, center), com), inertial))
        return times(arb(-1), force), times(arb(-1), moment)

    def _size(self) -> tuple[float, float]:
        """Weights, inertial forces and load [N], and their moments about the platform's centre [N m]: largest sums."""

        def length(v: Vector) -> float:
            return math.hypot(*(float(x) for x in v))

        platform, load = self.scene.platform, self.scene.load
        lever = max(length(leg.r) for leg in self.legs)
        moving = [(float(m), length(a)) for leg in self.legs for m, _, a, _ in leg.bodies]
        force = sum(m * (a + length(self.g)) for m, a in (*moving, (platform.mass, length(self.C[2]))))
        force += math.hypot(*load.force) if load else 0.0
        turning = length(self.alpha) + length(self.omega) ** 2
        moment = force * lever + float(np.linalg.norm(platform.tensor)) * turning
        return force, moment + (math.hypot(*load.moment) if load else 0.0)

    def _equations(self) -> _Equations:
        """The platform's equations in the components of the loop forces along the legs."""
        right_F, right_M, spent = self._platform()
        spatial = self.scene.topology == "spatial"
        # Hinges n and o are passive: M_n . z_n = 0 and M_o . y_r = 0 (of a thin leg, then, M_n = 0) give two components
        # of F_r; along y_n it is free. A planar leg has no hinge o, and F_r no component along z_r.
        known, along, inertial = [], [], []
        for leg in self.legs:
            x, y, z = (e[0] for e in leg.frame.axes)
            arm_n = cross(z, times(leg.L[0], y))  # (L y x F) . z = F . (z x L y)
            F_r = times(dot(leg.M_n, z) / dot(arm_n, x), x)
            if spatial:
                passive = x if self.thin else leg.y_r
                arm_o = cross(passive, times(leg.L[0], y))
                F_r = plus(F_r, times(dot(leg.M_o, passive) / dot(arm_o, z), z))
            known.append(F_r)
            along.append((*y, *cross(leg.r, y)))
            inertial.append(dot(leg.F_s, y))
            right_F = plus(right_F, F_r)
            right_M = plus(right_M, cross(leg.r, F_r))
        rows = {"spatial": (0, 1, 2, 3, 4, 5), "planar": (0, 1, 5), "point": (0, 1)}[self.scene.freedom]
        return _Equations(rows, (*right_F, *right_M), known, along, inertial, spent)

    def left_over(self, F: Sequence[arb]) -> list[arb]:
        """What given driving forces [N] leave of the platform's equations [N, N m]: affine in its accelerations."""
        e = self._equations()
        free = [inertial - f for inertial, f in zip(e.inertial, F, strict=True)]
        return [total(e.right[j], *(u * column[j] for u, column in zip(free, e.along, strict=True))) for j in e.rows]

    def under(self, F: Sequence[arb]) -> dict[str, list]:
        """Every reaction under driving forces [N] that fit the motion, lengths and rates of the legs."""
        e = self._equations()
        out: dict[str, list] = {}
        for leg, F_r, inertial, f in zip(self.legs, e.known, e.inertial, F, strict=True):
            F_r = plus(F_r, times(inertial - f, leg.frame.axes[1][0]))
            for name, value in leg.reactions(self.a, F_r).items():
                out.setdefault(name, []).append(value)
        out["F"] = [dot(F_s, leg.frame.axes[1][0]) for F_s, leg in zip(out["F_s"], self.legs, strict=True)]
        out["L"], out["dL"] = ([leg.L[d] for leg in self.legs] for d in (0, 1))
        out["F_hull"], out["M_hull"] = ([v] for v in self._on_hull())
        return out

    def solve(self) -> dict[str, list]:
        """Forces along the legs from the platform, then every reaction.

        Raises Infeasible, and ZeroDivisionError if none is certain.
        """
        e = self._equations()
        spent, size, twist = e.spent, self._size(), (*self.C[1], *self.omega)
        left = {j: e.right[j] for j in e.rows if all(x.is_exact() and x == 0 for x in (c[j] for c in e.along))}
        for j, b in left.items():
            if not abs(float(b)) <= FEASIBLE * size[j // 3]:
                raise Infeasible(f"no forces give this motion: residual {float(b):.6g} ({'N' if j < 3 else 'N m'})")
            spent = spent - b * twist[j]  # what the motion takes, and no force gives
        kept = [j for j in e.rows if j not in left]
        free = _free_forces([[-column[j] for column in e.along] for j in kept], [e.right[j] for j in kept], e.inertial)
        out = self.under([inertial - u for inertial, u in zip(e.inertial, free, strict=True)])
        spent = total(spent, *(leg.power for leg in self.legs))
        out["power"] = [spent - total(*(F * dL for F, dL in zip(out["F"], out["dL"], strict=True)))]
        return out


class Infeasible(ArithmeticError):
    """An equation of the platform that holds no force, and that the motion does not fulfil."""


def _free_forces(rows: list[list[arb]], right: list[arb], inertial: Sequence[arb]) -> list[arb]:
    """Components of F_r along the legs from the platform's equations. Raises ZeroDivisionError.

    Without one of them (two legs exactly in line) the solution with the shortest driving forces
    F = inertial - free is taken.
    """
    A = arb_mat(rows)
    b = arb_mat([[x] for x in right])
    if len(rows) == len(inertial):
        return [x[0] for x in A.solve(b).tolist()]
    to_span = A.transpose() * (A * A.transpose()).inv()
    F = arb_mat([[c] for c in inertial])
    free = to_span * b + F - to_span * (A * F)
    return [x[0] for x in free.tolist()]
