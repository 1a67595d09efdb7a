"""Simulations against prescribed motions, energy, convergence order and drift; orientations at the interface."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from conftest import parameters
from machines import motion_at, random_scene, with_legs

from stewart_crosscheck.analytic import (
    GimbalLock,
    Simulation,
    SimulationError,
    State,
    cardan_from_quaternion,
    constrained,
    energy_defect,
    quaternion_from_cardan,
    simulate,
    simulate_constrained,
    stewart,
)
from stewart_crosscheck.analytic.forward import FORMS
from stewart_crosscheck.analytic.integrate import integrate
from stewart_crosscheck.analytic.orientation import rotation, turned
from stewart_crosscheck.analytic.simulate import Forces, energies
from stewart_crosscheck.crosscheck import quaternions
from stewart_crosscheck.crosscheck.trajectory import Trajectory, from_scene
from stewart_crosscheck.models import Scene

FOLLOWS = 1e-11
"""m and 1. Round-off of 1e-15 per step grows by some 2e2 in 1 s: nothing holds the platform. Measured 5e-14."""

ENERGY = 1e-12
"""Of the work exchanged: round-off of some 50 steps and of energies ten times as large. Measured 2e-14."""


def start(scene: Scene) -> State:
    motion, q = motion_at(scene, 0.0)
    return State(motion.C_p, q, motion.dC_p, motion.w_p)


def driving(scene: Scene) -> Forces:
    """Closed-form inverse dynamics along the scene's motion, at any time."""
    P = parameters(scene)

    def solve(rows: Any, right: Any) -> list[float]:
        return np.linalg.solve(np.array(rows), np.array(right)).tolist()

    return lambda t: stewart.first_problem(P, motion_at(scene, t)[0], math.sqrt, solve).F


def away(scene: Scene, s: Simulation) -> np.ndarray:
    """Distance from the prescribed pose at each time: m, and of the quaternions up to their sign."""
    poses = [motion_at(scene, t) for t in s.t]
    distance = np.abs([m.C_p - p for (m, _), p in zip(poses, s.position, strict=True)]).max(axis=1)
    turn = [min(np.abs(q - u).max(), np.abs(q + u).max()) for (_, q), u in zip(poses, s.quaternion, strict=True)]
    return np.maximum(distance, turn)


def test_motion_at_any_time_is_the_scenes_motion(hexapod: Scene, trajectory: Trajectory) -> None:
    for scene in (hexapod, random_scene(0)):
        tr = from_scene(scene, 5)
        for k, t in enumerate(tr.t):
            motion, q = motion_at(scene, t)
            np.testing.assert_allclose(q, tr.quaternion[k], rtol=0, atol=1e-15)  # rounding
            for name, a in zip(motion._fields, motion, strict=True):
                np.testing.assert_allclose(a, getattr(tr.motion, name)[k], rtol=0, atol=1e-14)  # up to 10 m/s^2


# --- Minimal coordinates ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", FORMS)
def test_driving_forces_lead_along_the_motion(form: str, hexapod: Scene) -> None:
    s = simulate(parameters(hexapod), start(hexapod), driving(hexapod), np.linspace(0, 1, 11), form=form)
    assert away(hexapod, s).max() < FOLLOWS
    want = motion_at(hexapod, 1.0)[0]
    np.testing.assert_allclose(s.velocity[-1], want.dC_p, rtol=0, atol=FOLLOWS)
    np.testing.assert_allclose(s.angular_velocity[-1], want.w_p, rtol=0, atol=FOLLOWS)
    assert s.nfev < 2000  # measured 700: the steps are those of a smooth motion


@pytest.mark.parametrize("seed", range(2))
def test_energy_is_the_work_done(seed: int) -> None:
    """With and without bases, under inclined gravity and a load."""
    scene = random_scene(seed, base=seed == 0, gravity=(3.0, -8.0, 2.0))
    s = simulate(parameters(scene), start(scene), driving(scene), np.linspace(0, 1, 11))
    assert away(scene, s).max() < FOLLOWS
    assert np.abs(energy_defect(parameters(scene), s)).max() < ENERGY * np.ptp(s.work)


@pytest.mark.parametrize("N", [3, 8])
def test_free_legs_keep_the_energy(N: int) -> None:
    """No driving forces and no load: what falls gains what it loses."""
    scene = with_legs(random_scene(2, gravity=(1.0, -9.0, 2.0)), N)
    P = dataclasses.replace(parameters(scene), load=stewart.Load())
    s = simulate(P, start(random_scene(2)), lambda t: [0.0] * N, np.linspace(0, 0.2, 5))
    assert np.abs(s.work).max() == 0.0
    T, _ = energies(P, s.motion)
    assert np.abs(energy_defect(P, s)).max() < ENERGY * np.ptp(T)
    assert np.ptp(T) > 1.0


@pytest.mark.parametrize(
    ("name", "breaking"),
    [
        ("power", lambda f: lambda *a: (f(*a)[0], -f(*a)[1])),
        ("power", lambda f: lambda *a: (-f(*a)[0], f(*a)[1])),
        ("energy", lambda f: lambda *a: (f(*a)[0], -f(*a)[1])),
        ("energy", lambda f: lambda P, m, legs: f(P, m, [k._replace(w=0.0 * k.w) for k in legs])),
        ("energy", lambda f: lambda P, m, legs: f(P, m, [k._replace(dq_n=0.0 * k.w) for k in legs])),
        ("energy", lambda f: lambda P, m, legs: f(P, m, [k._replace(dq_s=0.0 * k.w) for k in legs])),
        ("energy", lambda f: lambda P, m, legs: f(P, m, [k._replace(c=0.99 * k.c) for k in legs])),
        ("energy", lambda f: lambda P, m, legs: f(dataclasses.replace(P, m_p=0.99 * P.m_p), m, legs)),
    ],
)
def test_a_wrong_term_of_the_energy_shows(name: str, breaking: Callable, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = random_scene(0)
    monkeypatch.setattr(stewart, name, breaking(getattr(stewart, name)))
    s = simulate(parameters(scene), start(scene), driving(scene), np.linspace(0, 0.3, 3))
    assert np.abs(energy_defect(parameters(scene), s)).max() > 1e-5 * np.ptp(s.work)


def test_a_wrong_force_leads_away(hexapod: Scene) -> None:
    F = driving(hexapod)
    wrong = simulate(parameters(hexapod), start(hexapod), lambda t: np.array(F(t)) * (1 + 1e-8), np.array([0.0, 0.5]))
    assert away(hexapod, wrong)[-1] > 1e-10


def orders(errors: list[float]) -> list[float]:
    return [math.log2(a / b) for a, b in pairwise(errors)]


def test_fixed_steps_are_of_order_4(hexapod: Scene) -> None:
    """Halved steps, errors over 16; the order, not a cap, tells a right stage from a nearly right one."""
    F = driving(hexapod)
    simulations = [
        simulate(parameters(hexapod), start(hexapod), F, np.array([0.0, 0.5]), dt) for dt in (0.02, 0.01, 0.005)
    ]
    assert [s.nfev for s in simulations] == [100, 200, 400]
    for order in orders([float(away(hexapod, s)[-1]) for s in simulations]):
        assert order == pytest.approx(4.0, abs=0.2)  # measured 3.97 and 3.99: the next term of the error


def test_the_tolerance_of_adaptive_steps_is_obeyed(hexapod: Scene) -> None:
    """An error is some tens of the tolerance per step; it grows a hundred times in a second, less in a half."""
    t = np.linspace(0.0, 0.5, 6)
    for rtol in (1e-4, 1e-7, 1e-10):
        error = away(hexapod, simulate(parameters(hexapod), start(hexapod), driving(hexapod), t, rtol=rtol)).max()
        assert 1e-3 * rtol < error < 1e2 * rtol
    with pytest.raises(ValueError, match="rtol: got 1e-16, expected at least 1e-13 and less than 1"):
        simulate(parameters(hexapod), start(hexapod), driving(hexapod), t, rtol=1e-16)


def test_intervals_of_n_steps_take_n_steps(hexapod: Scene) -> None:
    t = 0.1 * np.arange(4)  # 0, 0.1, 0.2, 0.30000000000000004: one interval is longer than 0.1
    s = simulate(parameters(hexapod), start(hexapod), driving(hexapod), t, 0.1)
    assert s.nfev == 12


def test_the_sign_of_the_initial_quaternion_does_not_matter(hexapod: Scene) -> None:
    initial, t = start(hexapod), np.linspace(0, 0.1, 3)
    other = dataclasses.replace(initial, quaternion=[-x for x in initial.quaternion])
    a, b = (simulate(parameters(hexapod), i, driving(hexapod), t, 0.05) for i in (initial, other))
    np.testing.assert_array_equal(a.quaternion, b.quaternion)
    assert a.quaternion[0, 0] > 0
    np.testing.assert_allclose(np.linalg.norm(a.quaternion, axis=1), 1.0, rtol=0, atol=3e-16)


# --- All coordinates --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("how", [{}, {"gain": 20.0}, {"projection": True}], ids=["free", "baumgarte", "projection"])
@pytest.mark.parametrize("base", [True, False])
def test_all_coordinates_lead_along_the_motion(how: dict[str, Any], base: bool) -> None:
    scene = random_scene(1, base=base, gravity=(3.0, -8.0, 2.0))
    s = simulate_constrained(parameters(scene), start(scene), driving(scene), np.linspace(0, 0.5, 3), **how)
    assert away(scene, s).max() < FOLLOWS
    assert s.gap.max() < 1e-12  # m; DOP853 at 1e-13 per step: drift of some 10 to 100 roundings
    assert np.abs(energy_defect(parameters(scene), s)).max() < ENERGY * np.ptp(s.work)
    tr = from_scene(scene, 3)  # at 0, 0.5 and 1 s
    for j, letter in enumerate("ons"):
        for i in range(6):
            np.testing.assert_allclose(s.q[::2, i, j], tr.q[f"{letter}{i + 1}"][:2], rtol=0, atol=FOLLOWS)
            np.testing.assert_allclose(s.dq[::2, i, j], tr.v[f"{letter}{i + 1}"][:2], rtol=0, atol=10 * FOLLOWS)


@pytest.fixture(scope="module")
def drifting(hexapod: Scene) -> dict[str, Any]:
    """Fixed steps, large enough for their errors to be seen, over 2 s."""
    t, F = np.linspace(0, 2, 21), driving(hexapod)
    ways = {"free": {}, "baumgarte": {"gain": 20.0}, "projection": {"projection": True}}
    return {
        name: simulate_constrained(parameters(hexapod), start(hexapod), F, t, 0.02, **how) for name, how in ways.items()
    }


def test_without_stabilisation_the_loops_drift_apart(drifting: dict[str, Any]) -> None:
    """gap'' = 0 holds a gap' that is not zero: the gap grows with time."""
    gap = drifting["free"].gap.max(axis=1)
    assert gap[0] < 1e-15
    assert 1e-8 < gap[5] < 0.7 * gap[10] < 0.7 * gap[20] < 1e-5  # growing all the time


def test_baumgarte_holds_the_gap_where_it_is_made(drifting: dict[str, Any]) -> None:
    """A gap closes in some 1/gain = 0.05 s: what is there is the integrator's latest error."""
    gap = drifting["baumgarte"].gap.max(axis=1)
    assert gap[11:].max() < gap[:11].max()
    assert gap[11:].min() > 1e-9  # held, not closed: the integrator goes on feeding it


def test_projection_closes_the_loops(drifting: dict[str, Any]) -> None:
    s = drifting["projection"]
    assert s.gap.max() < 2e-15  # m, rounding of lengths of 1 m
    assert s.dgap.max() < 2e-15  # m/s


def test_baumgarte_closes_a_gap_by_its_law(hexapod: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """From rest a gap g follows gap'' + 2 gain gap' + gain^2 gap = 0: (1 + gain t) exp(-gain t) g; with gain 0, g."""
    original = constrained._joints

    def open_loop(*a: Any) -> tuple[list[float], list[float]]:
        q, dq = original(*a)
        return [*q[:5], q[5] + 1e-6, *q[6:]], dq  # q_s of leg 2

    monkeypatch.setattr(constrained, "_joints", open_loop)
    at_rest = dataclasses.replace(start(hexapod), velocity=(0, 0, 0), angular_velocity=(0, 0, 0))
    F, t = driving(hexapod), np.linspace(0, 0.2, 5)
    for gain in (0.0, 20.0):
        s = simulate_constrained(parameters(hexapod), at_rest, F, t, gain=gain)
        law = 1e-6 * (1 + gain * t) * np.exp(-gain * t)
        np.testing.assert_allclose(s.gap[:, 1], law, rtol=0, atol=1e-13)  # m: round-off, as for a closed loop
        assert np.delete(s.gap, 1, axis=1).max() < 1e-13
    closed = simulate_constrained(parameters(hexapod), at_rest, F, t, projection=True)
    assert closed.gap[0, 1] == pytest.approx(1e-6, rel=1e-6)
    assert closed.gap[1:].max() < 2e-15


def test_projection_is_the_nearest_by_mass(hexapod: Scene) -> None:
    """M d is orthogonal to every motion that keeps the loops closed: no energy of such a motion is made or lost."""
    P = parameters(hexapod)
    s = simulate_constrained(P, start(hexapod), driving(hexapod), np.array([0.0, 0.1]), 0.05)
    numbers = (s.position, s.quaternion, s.q, s.velocity, s.angular_velocity, s.dq)
    at = constrained._Coordinates(P, np.concatenate([*(np.ravel(x[1]) for x in numbers), [0.0]]))
    d = constrained._nearest(P, at, np.random.default_rng(3).normal(size=18))
    keeping = np.linalg.svd(np.array(stewart.loop_rows(at.legs)))[2][18:]  # six motions
    leg_inertia = np.concatenate([stewart.joint_inertia(P.leg, k) for k in at.legs])
    momentum = np.concatenate([np.array(stewart.platform_inertia(P, at.motion)) @ d[:6], leg_inertia * d[6:]])
    assert np.abs(keeping @ momentum).max() < 1e-13 * np.abs(momentum).max()  # two solutions, condition below 1e2


def test_steps_go_on_from_the_projected_state() -> None:
    """y' = y, multiplied by 1.001 after each of n steps, is e^t 1.001^n: outputs, and what starts the next step."""
    calls = 0

    def grown(y: np.ndarray) -> np.ndarray:
        nonlocal calls
        calls += 1
        return 1.001 * y

    y, _ = integrate(lambda t, y: y, np.ones(1), np.array([0.0, 3.0]), project=grown)
    steps = calls - 1  # one call for the output
    assert steps > 10
    assert y[-1, 0] == pytest.approx(math.exp(3.0) * 1.001**steps, rel=1e-11)  # 1e-13 per step


def test_drift_is_of_the_order_of_the_steps(hexapod: Scene) -> None:
    """Order 4 as the integrator's; for projected loops the pose shows it."""
    F, t = driving(hexapod), np.array([0.0, 0.5])
    steps = (0.02, 0.01, 0.005)
    free = [simulate_constrained(parameters(hexapod), start(hexapod), F, t, dt) for dt in steps]
    closed = [simulate_constrained(parameters(hexapod), start(hexapod), F, t, dt, projection=True) for dt in steps]
    for order in orders([float(s.gap[-1].max()) for s in free]):
        assert order == pytest.approx(4.0, abs=0.3)
    for order in orders([float(away(hexapod, s)[-1]) for s in closed]):
        assert order == pytest.approx(4.0, abs=0.3)


def test_a_wrong_loop_rate_opens_the_loops(hexapod: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the legs' centripetal terms (31) is not the constraint that the gap measures."""
    original = stewart.second_derivative_along
    monkeypatch.setattr(
        stewart,
        "second_derivative_along",
        lambda k, h, f, df, ddf: original(k, h._replace(dq_o=0.0 * f), f, df, ddf),
    )
    s = simulate_constrained(parameters(hexapod), start(hexapod), driving(hexapod), np.array([0.0, 0.2]), 0.02)
    assert s.gap[-1].max() > 1e-4


# --- Errors -----------------------------------------------------------------------------------------------------------

ways = pytest.mark.parametrize("way", [simulate, simulate_constrained])


@ways
def test_forces_that_are_not_finite_name_the_time(way: Callable, hexapod: Scene) -> None:
    F = lambda t: [math.nan if t > 0.05 else 0.0] * 6  # noqa: E731
    with pytest.raises(SimulationError, match=r"t = 0\.0[0-9]+ s: F\(t\): got \[nan, .*expected finite forces"):
        way(parameters(hexapod), start(hexapod), F, np.array([0.0, 0.1]))


@ways
def test_a_wrong_number_of_forces(way: Callable, hexapod: Scene) -> None:
    with pytest.raises(SimulationError, match=r"t = 0 s: F\(t\): got shape \(5,\), expected \(6,\): one force per leg"):
        way(parameters(hexapod), start(hexapod), lambda t: [0.0] * 5, np.array([0.0, 0.1]))


@ways
def test_steps_that_shrink_to_nothing(way: Callable, hexapod: Scene) -> None:
    """A force that grows without bound at 10 ms: no step is small enough."""
    F = lambda t: [1.0 / (0.01 - t) ** 2 if t != 0.01 else 1e30] * 6  # noqa: E731
    with pytest.raises(SimulationError, match=r"t = 0\.00\d+ s: (the integrator failed: Required step|leg \d: )"):
        way(parameters(hexapod), start(hexapod), F, np.array([0.0, 0.1]))


def test_a_singular_leg_names_time_and_leg(hexapod: Scene) -> None:
    """A leg that is vertical at the start, its base turning: the base angle is not determined."""
    motion, q = motion_at(hexapod, 0.0)
    O = stewart.sub(stewart.add(motion.C_p, stewart.apply(motion.R, parameters(hexapod).p[2])), (0.0, 0.9, 0.0))
    P = dataclasses.replace(parameters(hexapod), O=(*parameters(hexapod).O[:2], O, *parameters(hexapod).O[3:]))
    initial = State(motion.C_p, q, motion.dC_p, motion.w_p)
    with pytest.raises(SimulationError, match=r"t = 0 s: leg 3: sin q_n = .* in the form 'compliance' rounding"):
        simulate(P, initial, lambda t: [0.0] * 6, np.array([0.0, 0.1]))


def test_steps_without_end_are_ended(hexapod: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stewart_crosscheck.analytic.integrate.MOST_STEPS", 5)
    message = r"t = 0\.\d+ s: 5 steps since the last output time: too fast to follow"
    with pytest.raises(SimulationError, match=message):
        simulate(parameters(hexapod), start(hexapod), driving(hexapod), np.array([0.0, 1.0]))
    simulate(parameters(hexapod), start(hexapod), driving(hexapod), np.linspace(0.0, 0.2, 11))  # 1 or 2 steps between


def test_a_derivative_that_overflows_is_named() -> None:
    with pytest.raises(SimulationError, match=r"t = 0 s: component 1 of the derivative is not finite"):
        integrate(lambda t, y: np.array([1.0, math.inf]), np.zeros(2), np.array([0.0, 1.0]))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"t": np.array([0.0])}, r"t: got shape \(1,\), expected at least two finite, increasing output times"),
        ({"t": np.array([0.0, 0.0])}, "t: got shape"),
        ({"t": np.array([0.0, math.nan])}, "t: got shape"),
        ({"dt": 0.0}, r"dt: got 0\.0, expected a positive step"),
        ({"initial": State((0, 1), (1, 0, 0, 0))}, r"initial\.position: got \[0.0, 1.0\], expected 3 finite numbers"),
        ({"initial": State((0, 1, 0), (1, 0, 0, 1))}, r"initial\.quaternion: got length 1\.414"),
        ({"initial": State((0, 1, 0), (1, 0, 0, 0), (math.inf, 0, 0))}, r"initial\.velocity: got \[inf"),
    ],
)
@ways
def test_unusable_input_is_named(way: Callable, change: dict[str, Any], message: str, hexapod: Scene) -> None:
    given = {"initial": start(hexapod), "F": lambda t: [0.0] * 6, "t": np.array([0.0, 0.1])}
    with pytest.raises(ValueError, match=message):
        way(parameters(hexapod), **(given | change))


def test_an_unusable_gain_is_named(hexapod: Scene) -> None:
    with pytest.raises(ValueError, match=r"gain: got -1\.0, expected 0 or a positive rate"):
        simulate_constrained(parameters(hexapod), start(hexapod), lambda t: [0.0] * 6, np.array([0.0, 0.1]), gain=-1.0)


# --- Orientations -----------------------------------------------------------------------------------------------------


def test_angles_and_quaternions_are_inverse() -> None:
    """R = Rx Ry Rz as the scene file has it, through the turns of the trajectory."""
    x = np.random.default_rng(1).uniform(-1, 1, (50, 3)) * np.array([math.pi, 1.57, math.pi])
    q = quaternion_from_cardan(x)
    zero = np.zeros(50)
    turns = [quaternions.turn(axis, (x[:, axis], zero, zero))[0] for axis in range(3)]
    np.testing.assert_allclose(q, quaternions.times(quaternions.times(*turns[:2]), turns[2]), rtol=0, atol=1e-15)
    # rounding over the smallest cos beta of the sample
    np.testing.assert_allclose(cardan_from_quaternion(q), x, rtol=0, atol=1e-15 / np.cos(x[:, 1]).min())
    R = np.moveaxis(np.array(rotation(q.T)), -1, 0)
    np.testing.assert_allclose(R, quaternions.rotation(q), rtol=0, atol=1e-15)


def test_gimbal_lock_is_refused() -> None:
    assert cardan_from_quaternion(quaternion_from_cardan([0.3, math.pi / 2 - 1e-7, 0.2]))[1] > 1.57
    with pytest.raises(GimbalLock, match=r"\|cos beta\| = .*, expected at least 1e-08: at beta = \+-90 deg"):
        cardan_from_quaternion(quaternion_from_cardan([[0.1, 0.2, 0.3], [0.3, math.pi / 2, 0.2]]))


def test_a_turn_is_an_exponential() -> None:
    rng = np.random.default_rng(2)
    for scale in (1.0, 1e-9, 0.0):
        x, zero = scale * rng.normal(size=(1, 3)), np.zeros((1, 3))
        q = quaternion_from_cardan(rng.uniform(-1, 1, 3))
        want = quaternions.times(quaternions.exponential((x, zero, zero))[0], q[None])[0]
        np.testing.assert_allclose(turned(q.tolist(), x[0].tolist()), want, rtol=0, atol=5e-16)
