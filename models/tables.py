"""Tables of the scene file, one class each: what a value may be, in which unit and in which axes."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

LARGEST = 1e20
"""Largest number in a scene or trajectory file, SI units: products of such numbers are finite in float64."""

MOST = 1000
"""Legs of a mechanism, terms of a component."""

Finite = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0, le=LARGEST)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0, le=LARGEST)]
Vector = tuple[Finite, Finite, Finite]
Pins = Annotated[tuple[Vector, ...], Field(min_length=1, max_length=MOST)]


class Table(BaseModel):
    """A table of the scene file: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Base(Table):
    """Base of a leg: mass [kg], J_z [kg m^2] about its hinge axis y_r; its centre of mass is at O_o."""

    mass: Positive
    J_z: Positive


class Guide(Table):
    """Guide: mass [kg], centre of mass at com [m] along y_n, J_x = J_z and J_y [kg m^2] about O_n.

    A planar scene need not give J_y and does not use it: nothing turns about the leg's long axis.
    """

    mass: Positive
    com: Finite
    J_x: Positive
    J_y: NotNegative = 0.0

    @property
    def central_J_x(self) -> float:
        """Transverse moment of inertia about the centre of mass [kg m^2]."""
        return self.J_x - self.mass * self.com**2

    @model_validator(mode="after")
    def _possible(self) -> Guide:
        if self.central_J_x <= 0:
            raise ValueError(
                f"J_x is about O_n: got {self.J_x}, expected more than mass * com^2 = {self.mass * self.com**2:.6g}"
            )
        if self.J_y > 2 * self.central_J_x:
            raise ValueError(
                f"J_y: got {self.J_y}, expected at most twice the central J_x - mass * com^2 = {self.central_J_x:.6g}"
                " (triangle inequality)"
            )
        return self


class Rod(Table):
    """Rod: mass [kg], central J_x = J_y transverse and J_z along y_n [kg m^2]; a planar scene does not use J_z."""

    mass: Positive
    J_x: Positive
    J_z: NotNegative = 0.0

    @model_validator(mode="after")
    def _possible(self) -> Rod:
        if self.J_z > 2 * self.J_x:
            raise ValueError(f"J_z: got {self.J_z}, expected at most 2 J_x = {2 * self.J_x} (triangle inequality)")
        return self


class LegTable(Table):
    """One leg, all are identical. `a` [m]: rod's tip from its centre of mass. Without `base`: a universal joint."""

    a: Finite
    base: Base | None = None
    guide: Guide
    rod: Rod


class Platform(Table):
    """Platform: mass [kg], central inertia [kg m^2] and pins [m] in its own axes.

    In a planar scene `J_z` [kg m^2] stands for the inertia; a point mass has neither `J_z` nor pins.
    """

    mass: Positive
    inertia: tuple[Vector, Vector, Vector] | None = None
    J_z: Positive | None = None
    pins: Pins | None = None

    @property
    def tensor(self) -> tuple[Vector, Vector, Vector]:
        """Central inertia [kg m^2], platform axes; of a planar platform about z alone."""
        return self.inertia or ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, self.J_z or 0.0))

    @property
    def least_inertia(self) -> float:
        """Smallest principal moment [kg m^2] that the platform turns with; infinite for a point, which does not."""
        if self.inertia is not None:
            return float(np.linalg.eigvalsh(np.array(self.inertia))[0])
        return self.J_z or math.inf

    @model_validator(mode="after")
    def _possible(self) -> Platform:
        if self.inertia is None:
            return self
        for i, j in ((0, 1), (0, 2), (1, 2)):
            upper, lower = self.inertia[i][j], self.inertia[j][i]
            if upper != lower:
                raise ValueError(
                    f"inertia: got [{i}][{j}] = {upper} and [{j}][{i}] = {lower}, expected a symmetric one"
                )
        low, mid, high = np.linalg.eigvalsh(np.array(self.inertia))
        principal = f"principal moments {low:.6g}, {mid:.6g}, {high:.6g}"
        if low <= 0:
            raise ValueError(f"inertia: got {principal}, expected three positive ones")
        if high > (low + mid) * (1 + 1e-12):  # eigenvalues carry rounding
            raise ValueError(
                f"inertia: got {principal}, expected none above the sum of the others (triangle inequality)"
            )
        return self


class Hull(Table):
    """Hull pins O_oi = (A_i, B_i, D_i) [m], world axes."""

    pins: Pins


class Component(Table):
    """c0 + sum of amplitude * sin(omega t + phase); terms are [amplitude, omega in rad/s, phase in rad]."""

    c0: Finite = 0.0
    terms: Annotated[tuple[Vector, ...], Field(max_length=MOST)] = ()

    @property
    def is_zero(self) -> bool:
        """Whether it is zero at all times, and says nothing else."""
        return self.c0 == 0.0 and not self.terms


class Orientation(Table):
    """cardan_xyz: R = Rx Ry Rz of three angles [rad]; rotation_vector: axis times angle [rad]."""

    kind: Literal["cardan_xyz", "rotation_vector"]
    components: tuple[Component, Component, Component]


class Motion(Table):
    """Default trajectory: duration [s], position [m] of the platform's centre of mass, orientation (not of a point)."""

    duration: Positive
    position: tuple[Component, Component, Component]
    orientation: Orientation | None = None


class LoadTable(Table):
    """Outside force [N, world axes] at `point` [m, platform axes] and moment [N m, world axes] on the platform."""

    force: Vector = (0.0, 0.0, 0.0)
    moment: Vector = (0.0, 0.0, 0.0)
    point: Vector = (0.0, 0.0, 0.0)


class InitialOrientation(Table):
    """Angles [rad] of a start, as in `Orientation`."""

    kind: Literal["cardan_xyz", "rotation_vector"]
    angles: Vector


class Initial(Table):
    """Start of a simulation: pose and twist of the platform, world axes. `run` does not read it."""

    position: Vector
    orientation: InitialOrientation | None = None
    velocity: Vector = (0.0, 0.0, 0.0)
    angular_velocity: Vector = (0.0, 0.0, 0.0)


class LegForces(Table):
    """Driving forces of a simulation [N], one component per leg. `run` does not read them."""

    legs: Annotated[tuple[Component, ...], Field(max_length=MOST)]
