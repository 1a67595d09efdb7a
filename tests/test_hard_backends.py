"""Every back end of the formulas at hard points: within what half-ulp inputs make of the exact answer, or an error."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from conftest import parameters

from stewart_crosscheck.analytic import ControlLoop, SingularPose, forward_dynamics, inverse_dynamics
from stewart_crosscheck.analytic.backends import BACKENDS
from stewart_crosscheck.crosscheck.certainty import Certain, certain_forward, certain_inverse
from stewart_crosscheck.crosscheck.engine import by_joint, quantity
from stewart_crosscheck.crosscheck.engines.analytic_ import _motion
from stewart_crosscheck.crosscheck.hard import Case, Point, load_family
from stewart_crosscheck.crosscheck.outcome import NEAR_SENSITIVITY, Place

CASES = {c.name: c for family in ("steep", "parallel") for c in load_family(family) if isinstance(c, Case)}
HARD = [
    ("steep_moving", 1e-4),
    ("steep_moving", 1e-9),
    ("steep_meridian_thin", 1e-10),
    ("steep_moving_thin", 0.0),
    ("parallel_yaw", 1e-6),
    ("parallel_yaw", 1e-11),
]


@cache
def at(name: str, value: float) -> tuple[Point, Certain, Certain]:
    point = CASES[name].at(value)
    return point, certain_inverse(point), certain_forward(point)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("name", "value"), HARD)
def test_forces_and_reactions(backend: str, name: str, value: float) -> None:
    point, truth, _ = at(name, value)
    scene, place = point.scene, Place.of(point, truth)
    D = inverse_dynamics(parameters(scene), _motion(point.row), backend)
    reactions = by_joint(scene, vars(D))
    for q in scene.quantities:
        off = quantity(scene, q, D.F, reactions)[0] - place.exact(q)
        error = np.linalg.norm(off, axis=1).max() / place.size.of(q)
        assert error <= NEAR_SENSITIVITY * place.sensitivity(q), q


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("name", "value"), [(n, v) for n, v in HARD if (n, v) != ("steep_moving", 1e-9)])
def test_accelerations(backend: str, name: str, value: float) -> None:
    point, _, truth = at(name, value)
    place = Place.of(point, truth)
    a = forward_dynamics(parameters(point.scene), _motion(point.row), np.array([point.forces]), backend=backend)
    for q, got in (("a", a.ddC_p[0]), ("alpha", a.dw_p[0])):
        error = np.linalg.norm(got - place.exact(q)[0]) / place.size.of(q)
        assert error <= NEAR_SENSITIVITY * place.sensitivity(q), q


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("name", "says"), [("steep_moving", "leg 1: sin q_n = 0,"), ("parallel_yaw", "in a parallel singularity")]
)
def test_where_there_is_no_answer_there_is_an_error(backend: str, name: str, says: str) -> None:
    point = CASES[name].at(0.0)
    with pytest.raises(SingularPose, match=says):
        inverse_dynamics(parameters(point.scene), _motion(point.row), backend)


@pytest.mark.parametrize(("name", "value"), HARD)
def test_a_control_loop(name: str, value: float) -> None:
    point, truth, _ = at(name, value)
    place = Place.of(point, truth)
    loop = ControlLoop(parameters(point.scene))
    loop.given[:] = np.concatenate([np.ravel(x[0]) for x in _motion(point.row)])
    loop()
    error = np.abs(loop.found[:6] - place.exact("F")[:, 0]).max() / place.size.of("F")
    assert error <= NEAR_SENSITIVITY * place.sensitivity("F")
