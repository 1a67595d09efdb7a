"""The first problem by the equations as printed, and the rounding that it says it leaves."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import parameters
from machines import random_scene, with_legs

from stewart_crosscheck import analytic
from stewart_crosscheck.analytic import NotDeterminate, SingularPose, printed
from stewart_crosscheck.crosscheck.certainty import certain_inverse
from stewart_crosscheck.crosscheck.engines.analytic_ import _motion
from stewart_crosscheck.crosscheck.hard import load_family
from stewart_crosscheck.crosscheck.trajectory import Trajectory, from_scene
from stewart_crosscheck.models import Scene

STEEP = {case.name: case for case in load_family("steep")}


def test_the_same_numbers_where_nothing_cancels(hexapod: Scene, trajectory: Trajectory) -> None:
    found, rounding = analytic.inverse_dynamics_printed(parameters(hexapod), trajectory.motion)
    want = analytic.inverse_dynamics(parameters(hexapod), trajectory.motion)
    off = np.abs(found.numbers - want.numbers).max(axis=0)
    assert found.numbers.shape == want.numbers.shape
    assert (0 < off).all()  # other sums: not the same code
    assert (off < rounding).all()
    assert (rounding < 1e-13 * 1e3 * np.abs(want.F).max(axis=1)).all()


@pytest.mark.parametrize("name", ["steep_rest", "steep_moving", "steep_rest_thin", "steep_moving_thin"])
@pytest.mark.parametrize("s", [1e-1, 1e-3, 1e-4])
def test_errors_lie_below_the_rounding_that_is_stated(name: str, s: float) -> None:
    """And not by more than three decades: the estimate is worth something."""
    point = STEEP[name].at(s)
    found, rounding = analytic.inverse_dynamics_printed(parameters(point.scene), _motion(point.row))
    error = np.abs(found.F - certain_inverse(point).result.F).max()
    assert error < rounding[0]
    if error > 1e-9:
        assert rounding[0] < 1e3 * error


def test_no_digits_are_no_answer() -> None:
    """(22) divides what cancels by s: the forces without cancellation are right, the printed ones are none."""
    point = STEEP["steep_moving_thin"].at(1e-7)
    P = parameters(point.scene)
    with pytest.raises(ArithmeticError, match=r"sample 0: the equations as printed leave no digits: rounding of up to"):
        analytic.inverse_dynamics_printed(P, _motion(point.row))
    right = analytic.driving_forces(P, _motion(point.row))
    truth = certain_inverse(point)
    assert np.abs(right - truth.result.F).max() < 100 * truth.sensitivity["F"]


def test_without_the_estimate_garbage_would_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    point = STEEP["steep_moving_thin"].at(1e-8)
    monkeypatch.setattr(printed, "NO_DIGITS", np.inf)
    found, _ = analytic.inverse_dynamics_printed(parameters(point.scene), _motion(point.row))
    right = certain_inverse(point).result.F
    assert np.abs(found.F - right).max() > 1e3 * np.abs(right).max()


def test_refusals(hexapod: Scene, trajectory: Trajectory) -> None:
    vertical = STEEP["steep_rest_thin"].at(0.0)
    with pytest.raises(SingularPose, match=r"leg 1: sin q_n = .*\(22\) divides by it"):
        analytic.inverse_dynamics_printed(parameters(vertical.scene), _motion(vertical.row))
    with pytest.raises(NotDeterminate):
        analytic.inverse_dynamics_printed(parameters(with_legs(hexapod, 5)), trajectory.motion)
    inclined = random_scene(3, gravity=(1.0, -9.0, 0.5))
    with pytest.raises(ValueError, match=r"\(20\)-\(22\) hold for gravity along -y_r only"):
        analytic.inverse_dynamics_printed(parameters(inclined), from_scene(inclined, 3).motion)


def test_long_motions_go_block_by_block(hexapod: Scene, trajectory: Trajectory) -> None:
    P, count = parameters(hexapod), 2100 // len(trajectory.t)
    motion = analytic.PlatformMotion(*(np.concatenate([x] * count) for x in trajectory.motion))
    once, rounding = analytic.inverse_dynamics_printed(P, trajectory.motion)
    often, as_often = analytic.inverse_dynamics_printed(P, motion)
    np.testing.assert_array_equal(often.numbers, np.hstack([once.numbers] * count))
    np.testing.assert_array_equal(as_often, np.concatenate([rounding] * count))
    motion.R[2080] = np.eye(3)
    motion.C_p[2080] = np.subtract(P.O[0], P.p[0]) + np.array([0.0, 0.9, 0.0])
    with pytest.raises(SingularPose, match="sample 2080, leg 1: sin q_n"):
        analytic.inverse_dynamics_printed(P, motion)
