"""Simulation in minimal coordinates: pose and twist of the platform; the legs follow it, so that no loop can open."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from . import stewart
from .forward import Mechanism, accelerations
from .integrate import RTOL, SimulationError, integrate
from .orientation import quaternion_rate, rotation
from .stewart import PlanarParameters, PlatformMotion

Forces = Callable[[float], Sequence[float] | np.ndarray]
"""Driving forces (N,) [N] at a time [s]."""


@dataclass(frozen=True)
class State:
    """Pose and twist, world axes: ``position`` m, ``quaternion`` scalar first, ``velocity`` m/s, rad/s."""

    position: Sequence[float]
    quaternion: Sequence[float]
    velocity: Sequence[float] = (0.0, 0.0, 0.0)
    angular_velocity: Sequence[float] = (0.0, 0.0, 0.0)

    def unit(self) -> np.ndarray:
        """The 13 numbers, quaternion of length 1 with q_w >= 0. Raises ValueError."""
        for name, length in (("position", 3), ("quaternion", 4), ("velocity", 3), ("angular_velocity", 3)):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape != (length,) or not np.isfinite(value).all():
                raise ValueError(f"initial.{name}: got {value.tolist()}, expected {length} finite numbers")
        q = np.asarray(self.quaternion, dtype=float)
        size = np.linalg.norm(q)
        if not abs(size - 1.0) <= 1e-6:
            raise ValueError(f"initial.quaternion: got length {size:.9g}, expected 1 within 1e-6")
        q = q / math.copysign(float(size), q[0])
        return np.concatenate([self.position, q, self.velocity, self.angular_velocity])


@dataclass(frozen=True)
class Simulation:
    """States of the platform at the times ``t`` (nt,), world axes, SI units.

    ``position, velocity, angular_velocity`` (nt, 3), ``quaternion`` (nt, 4) of length 1, continuous; ``work`` (nt,):
    of driving forces and load since t[0] [J]; ``nfev``: evaluations of the accelerations.
    """

    t: np.ndarray
    position: np.ndarray
    quaternion: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray
    work: np.ndarray
    nfev: int

    @property
    def motion(self) -> PlatformMotion:
        """Pose and twist as the formulas take them; accelerations are zero."""
        R = np.moveaxis(np.array(rotation(self.quaternion.T)), -1, 0)
        zero = np.zeros_like(self.position)
        return PlatformMotion(self.position, R, self.velocity, self.angular_velocity, zero, zero)


def forces_at(P: Mechanism, F: Forces, t: float) -> list[float]:
    """N driving forces as floats. Raises SimulationError for a wrong number of them or one that is not finite."""
    values = np.asarray(F(t), dtype=float)
    if values.shape != (len(P.p),):
        raise SimulationError(t, f"F(t): got shape {values.shape}, expected ({len(P.p)},): one force per leg")
    if not np.isfinite(values).all():
        raise SimulationError(t, f"F(t): got {values.tolist()}, expected finite forces")
    return values.tolist()


def simulate(
    P: Mechanism,
    initial: State,
    F: Forces,
    t: np.ndarray,
    dt: float | None = None,
    form: str = "compliance",
    rtol: float = RTOL,
) -> Simulation:
    """The platform's motion under driving forces F(t), from the state at t[0]; any N >= 1 of legs.

    Parameters
    ----------
    P : Parameters or PlanarParameters
    initial : State
    F : callable
        F(t) -> (N,) in N, + extends the leg.
    t : ndarray, shape (nt,)
        Output times [s], increasing.
    dt : largest step [s] of the classical Runge-Kutta method; None for DOP853 near round-off.
    form : of the equations, see `forward_dynamics`.
    rtol : of DOP853, relative error per step; by default at its tightest.

    Raises
    ------
    SimulationError
        A leg too steep or of no length, forces or states that are not finite, steps that shrink to nothing: with time.
    ValueError
        Unusable times, tolerance or initial state.
    """

    def derivative(now: float, y: np.ndarray) -> np.ndarray:
        *numbers, _ = y.tolist()
        q, dC_p, w_p = numbers[3:7], tuple(numbers[7:10]), tuple(numbers[10:13])
        motion = PlatformMotion(tuple(numbers[:3]), rotation(q), dC_p, w_p, stewart.ZERO, stewart.ZERO)
        forces = forces_at(P, F, now)
        one = accelerations(P, motion, forces, form)
        power = sum(stewart.power(P, motion, one.legs, forces))
        return np.array([*dC_p, *quaternion_rate(q, w_p), *one.ddC_p, *one.dw_p, power])

    y, nfev = integrate(derivative, np.append(initial.unit(), 0.0), t, dt, rtol=rtol)
    q = y[:, 3:7] / np.linalg.norm(y[:, 3:7], axis=1, keepdims=True)
    return Simulation(np.asarray(t, dtype=float), y[:, :3], q, y[:, 7:10], y[:, 10:13], y[:, 13], nfev)


def energies(P: Mechanism, motion: PlatformMotion) -> tuple[np.ndarray, np.ndarray]:
    """Kinetic and potential energy (nt,) [J] of a motion given as arrays; accelerations are not read."""
    m = PlatformMotion(*(np.moveaxis(np.asarray(a, dtype=float), 0, -1) for a in motion))
    if isinstance(P, PlanarParameters):
        pins = zip(P.p, P.O, strict=True)
        return stewart.planar_energy(P, m, [stewart.planar_leg_kinematics(P.leg, p, O, m, np.sqrt) for p, O in pins])
    held, legs = stewart.held_legs(P, m, np.sqrt)
    return stewart.energy(P, held, legs)


def energy_defect(P: Mechanism, simulation: Simulation) -> np.ndarray:
    """Energy minus its first value minus the work done, (nt,) [J]: zero for an exact solution."""
    total = np.sum(energies(P, simulation.motion), axis=0)
    return total - total[0] - simulation.work
