"""The pose of given leg lengths: known poses, many guesses, and every way to fail."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from conftest import parameters
from machines import motion_at, random_scene
from test_forward import symmetric

from stewart_crosscheck.analytic import AssemblyError, Parameters, PlatformMotion, assemble, stewart
from stewart_crosscheck.analytic.orientation import quaternion_from_cardan, rotation
from stewart_crosscheck.models import Scene

SAME = 1e-13
"""m and 1: lengths within a few roundings of 1 m, times a condition below 60."""


def lengths(P: Parameters, motion: PlatformMotion) -> list[float]:
    return [k.L for k in stewart.held_legs(P, motion, math.sqrt)[1]]


@pytest.mark.parametrize("seed", range(5))
def test_lengths_of_a_pose_lead_back_to_it(seed: int) -> None:
    scene, rng = random_scene(seed), np.random.default_rng(seed)
    motion, q = motion_at(scene, 0.4)
    L = lengths(parameters(scene), motion)
    for _ in range(5):
        guess = np.array(motion.C_p) + rng.uniform(-0.05, 0.05, 3)
        got = assemble(parameters(scene), L, guess, rng.uniform(0.5, 2.0) * (q + rng.uniform(-0.05, 0.05, 4)))
        assert np.abs(got.position - motion.C_p).max() < SAME
        assert abs(abs(np.dot(got.quaternion, q)) - 1.0) < SAME
        assert got.iterations <= 6  # digits double: 1e-2, 1e-4, 1e-8, 1e-16
        assert got.residual < 1e-14


def test_a_pose_is_found_at_once_from_itself(hexapod: Scene) -> None:
    motion, q = motion_at(hexapod, 0.0)
    assert assemble(parameters(hexapod), lengths(parameters(hexapod), motion), motion.C_p, q).iterations == 0


def test_far_guesses_end_in_a_pose_or_a_clear_failure(hexapod: Scene) -> None:
    """Whatever is returned has the lengths; other poses with the same lengths exist."""
    rng = np.random.default_rng(1)
    motion, _ = motion_at(hexapod, 0.7)
    L, failures = lengths(parameters(hexapod), motion), []
    for _ in range(40):
        try:
            got = assemble(parameters(hexapod), L, rng.normal(size=3), rng.normal(size=4))
        except AssemblyError as e:
            failures.append(str(e))
        else:
            pose = motion._replace(C_p=tuple(got.position), R=rotation(got.quaternion))
            np.testing.assert_allclose(lengths(parameters(hexapod), pose), L, rtol=0, atol=1e-14)  # rounding
    assert 0 < len(failures) < 30  # guesses of any orientation, 1 m away: about half fail
    for message in failures:
        assert "not converged in 50 steps" in message or "singular pose after" in message


def test_turns_are_limited(hexapod: Scene) -> None:
    """From guesses some 40 degrees and 0.4 m away: limited turns take 6.7 steps on average, free ones 11.5."""
    rng = np.random.default_rng(1)
    motion, _ = motion_at(hexapod, 0.7)
    L, iterations = lengths(parameters(hexapod), motion), []
    for _ in range(100):
        position, q = (
            np.array([0, 0.95, 0]) + 0.3 * rng.normal(size=3),
            np.array([1, 0, 0, 0]) + 0.4 * rng.normal(size=4),
        )
        try:
            iterations.append(assemble(parameters(hexapod), L, position, q).iterations)
        except AssemblyError:
            continue
    assert len(iterations) > 85  # of 100: the others have no pose near
    assert np.mean(iterations) < 8.0


def test_a_world_offset_is_no_obstacle(hexapod: Scene) -> None:
    """1e6 m away C_p itself has roundings of 1e-10 m: the lengths are met as far as that allows."""
    motion, q = motion_at(hexapod, 0.3)
    shift = (2.0**20, -(2.0**20), 2.0**20)
    far = dataclasses.replace(parameters(hexapod), O=tuple(stewart.add(o, shift) for o in parameters(hexapod).O))
    L = lengths(parameters(hexapod), motion)
    got = assemble(far, L, np.add(motion.C_p, shift) + 0.02, q)
    assert np.abs(got.position - np.add(motion.C_p, shift)).max() < 1e-8
    assert got.residual < 1e-8


@pytest.mark.parametrize("L", [[10.0, 1, 1, 1, 1, 1], [0.1] * 6, [5.0, 0.1, 5.0, 0.1, 5.0, 0.1]])
def test_lengths_out_of_reach_say_how_far(L: list[float], hexapod: Scene) -> None:
    message = r"not converged in 50 steps: lengths are off by up to [\d.]+ m: no pose near the guess has these"
    with pytest.raises(AssemblyError, match=message):
        assemble(parameters(hexapod), L, (0.0, 0.95, 0.0), (1.0, 0.0, 0.0, 0.0))


def test_a_singular_guess_is_named() -> None:
    P, motion = symmetric(math.pi / 2)
    L = [x + 0.01 * i for i, x in enumerate(lengths(P, motion))]
    message = r"singular pose after 0 steps: condition .*, above 1e\+12, leg \d the weakest; lengths are off"
    with pytest.raises(AssemblyError, match=message):
        assemble(P, L, motion.C_p, quaternion_from_cardan([0.0, math.pi / 2, 0.0]))


@pytest.mark.parametrize(
    ("L", "position", "quaternion", "message"),
    [
        ([1.0] * 5, (0, 1, 0), (1, 0, 0, 0), r"L: got \[1.0, 1.0, 1.0, 1.0, 1.0\], expected 6 finite numbers"),
        ([1.0] * 5 + [math.nan], (0, 1, 0), (1, 0, 0, 0), "L: got .*expected 6 finite numbers"),
        ([1.0] * 5 + [0.0], (0, 1, 0), (1, 0, 0, 0), "L: got .*expected positive lengths"),
        ([1.0] * 6, (0, math.inf, 0), (1, 0, 0, 0), "position: got .*expected 3 finite numbers"),
        ([1.0] * 6, (0, 1, 0), (0, 0, 0, 0), "quaternion: got length 0"),
    ],
)
def test_unusable_input_is_named(L: list, position: tuple, quaternion: tuple, message: str, hexapod: Scene) -> None:
    with pytest.raises(AssemblyError, match=message):
        assemble(parameters(hexapod), L, position, quaternion)


def test_six_legs_are_needed(hexapod: Scene) -> None:
    P = dataclasses.replace(parameters(hexapod), p=parameters(hexapod).p[:5], O=parameters(hexapod).O[:5])
    with pytest.raises(AssemblyError, match="N = 5 legs: six lengths determine a pose, so N must be 6"):
        assemble(P, [1.0] * 5, (0, 1, 0), (1, 0, 0, 0))


def test_a_guess_at_a_hull_pin_is_named(hexapod: Scene) -> None:
    P = parameters(hexapod)
    on_pin = stewart.sub(P.O[4], P.p[4])
    flat = dataclasses.replace(P, O=tuple(stewart.sub(o, on_pin) for o in P.O))
    flat = dataclasses.replace(flat, O=(*flat.O[:4], flat.p[4], flat.O[5]))
    with pytest.raises(AssemblyError, match="leg 5: length 0 after 0 steps"):
        assemble(flat, [1.0] * 6, (0, 0, 0), (1, 0, 0, 0))


def test_a_wrong_column_does_not_converge_in_a_few_steps(hexapod: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Newton with a wrong Jacobian loses its quadratic convergence, and is seen to."""
    motion, q = motion_at(hexapod, 0.4)
    L = lengths(parameters(hexapod), motion)
    guess = np.array(motion.C_p) + 0.03
    assert assemble(parameters(hexapod), L, guess, q).iterations <= 5
    monkeypatch.setattr(
        "stewart_crosscheck.analytic.assembly.cross", lambda a, b: stewart.mul(1.1, stewart.cross(a, b))
    )
    assert assemble(parameters(hexapod), L, guess, q).iterations > 7
