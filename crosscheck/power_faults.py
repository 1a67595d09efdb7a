"""The faults that are planted: in a number of a scene, in a term of the formulas, in a line of some text."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

from .. import analytic
from ..models import write_models
from . import power_parameters, power_terms
from .power_parameters import Parameter
from .power_work import FORMULAS, Place, Planted, anew, right


@dataclass(frozen=True)
class Nothing:
    """No fault: what `run` says of the engine as it is."""

    @contextlib.contextmanager
    def planted(self, place: Place, engine: str, d: float) -> Iterator[Planted]:
        """The right things."""
        with right(place) as given:
            yield given


@dataclass(frozen=True)
class Number:
    """A number of an engine's model files, of the load, which no file holds, or of what the formulas are given."""

    parameter: Parameter

    @contextlib.contextmanager
    def planted(self, place: Place, engine: str, d: float) -> Iterator[Planted]:
        """A wrong scene for the formulas, wrong model files for every other engine."""
        wrong = power_parameters.wrong(place.scene, self.parameter, d)
        in_files = engine != FORMULAS and self.parameter.path[0] != "load"
        yield Planted(place.scene if in_files else wrong, write_models(wrong), place.trajectory)


@dataclass(frozen=True)
class Term:
    """A term of the formulas, and so of the joint coordinates of every engine, if it is one of their kinematics."""

    number: int

    @contextlib.contextmanager
    def planted(self, place: Place, engine: str, d: float) -> Iterator[Planted]:
        """Wrong formulas, and a trajectory made with them."""
        with power_terms.faulty(self.number, d), right(place) as given:
            yield given._replace(trajectory=anew(place))


def coordinates(place: Place) -> dict[int, float]:
    """Terms that joint coordinates come from, which every engine is given."""
    with power_terms.recorded() as values:
        anew(place)
    return values


def coordinates_and_forces(place: Place) -> dict[int, float]:
    """Terms that the rows of the formulas come from: coordinates, driving forces, reactions."""
    with power_terms.recorded() as values:
        anew(place)
        analytic.inverse_dynamics(place.scene.parameters, place.trajectory.motion)
    return values


def sizes(place: Place) -> dict[int, float]:
    """The same terms, and the largest size of each along the motion, by the text itself on plain floats."""
    motion = place.trajectory.motion
    with power_terms.recorded() as values:
        anew(place)
        for k in range(len(place.trajectory.t)):
            one = analytic.PlatformMotion(*(x[k : k + 1] for x in motion))
            analytic.inverse_dynamics(place.scene.parameters, one, "float")
    return values
