"""Hard cases: what a case is, and the registry of their families. Adding a family is adding a file in `cases`.

A case sweeps one parameter towards the place where formulas or engines stop being right; each of its points is a scene
and one instant of a motion, from which inverse and forward dynamics are asked.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from ..models.scene import Scene
from . import cases

INVERSE, FORWARD = "inverse", "forward"
"""Problems: forces and reactions of a motion, accelerations under given forces."""


class Accelerated(NamedTuple):
    """Answer of an exact form of the forward problem at a point.

    ``platform`` (1, 6): acceleration and angular acceleration, world axes.  ``growth``: what the form says that it
    multiplies rounding by, at least 1.  ``rounding_alone``: that is all it states; else what `simulate` allows, too.
    """

    platform: np.ndarray
    growth: float = 1.0
    rounding_alone: bool = False


class Row(NamedTuple):
    """The platform's motion at an instant: exact float64, world axes, SI units; a quaternion of about length 1."""

    position: tuple[float, ...]
    quaternion: tuple[float, ...]
    velocity: tuple[float, ...]
    angular_velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    angular_acceleration: tuple[float, ...]


class Point(NamedTuple):
    """One value of a case's parameter: what every engine is asked about."""

    scene: Scene
    row: Row

    @property
    def forces(self) -> tuple[float, ...]:
        """Driving forces [N] of the forward problem: unequal shares of the weight, without gravity of that on Earth."""
        weight = sum(body.mass for body in self.scene.bodies) * (max(abs(g) for g in self.scene.gravity) or 9.81)
        return tuple(weight / self.scene.N * (1.0 + i / 10.0) for i in range(self.scene.N))


@dataclass(frozen=True)
class Case:
    """A parameter on its way to a hard place.

    ``name``: of the case, a Python name.  ``title``: one line for plots and tables.  ``parameter``: its name and unit.
    ``values``: of the parameter, as they are plotted.  ``at``: the point of a value.
    """

    name: str
    title: str
    parameter: str
    values: tuple[float, ...]
    at: Callable[[float], Point]


class Passage(NamedTuple):
    """One value of a case in time: a simulation that every engine is asked for.

    ``scene`` with `[motion]`, or with `[initial]` and `[forces]`.  ``duration`` [s], in so many ``intervals`` between
    output times.  ``step`` [s] of methods that take steps, and the ``other`` one, whose run gives the law of their
    errors: both divide the intervals.  ``settings``: attributes of engines by engine and integrator; if there are any,
    no other methods are asked.
    """

    scene: Scene
    duration: float
    intervals: int
    step: float
    other: float
    settings: Mapping[tuple[str, str], Mapping[str, float]] = MappingProxyType({})


@dataclass(frozen=True)
class TimeCase:
    """A parameter on its way to a motion that is hard to follow.

    As `Case`; ``at``: what is simulated at a value.
    """

    name: str
    title: str
    parameter: str
    values: tuple[float, ...]
    at: Callable[[float], Passage]


def decades(first: int, last: int) -> tuple[float, ...]:
    """Powers of ten from 10^first to 10^last, in this order."""
    step = 1 if last >= first else -1
    return tuple(float(f"1e{k}") for k in range(first, last + step, step))


def family_names() -> list[str]:
    """Families of cases: the files in `cases`."""
    return sorted(m.name.removesuffix("_") for m in pkgutil.iter_modules(cases.__path__) if m.name.endswith("_"))


class UnknownFamily(ValueError):
    """No family of that name; the message lists the valid ones."""


def load_family(name: str) -> tuple[Case, ...]:
    """Cases of a family. Raises UnknownFamily."""
    if name not in family_names():
        raise UnknownFamily(
            f"--family: got an unknown family of cases {name!r}, expected one of {', '.join(family_names())}"
        )
    return importlib.import_module(f"{cases.__name__}.{name}_").CASES
