"""The second problem of dynamics: three forms against the certified reference, independent bodies, and each other."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import flint
import numpy as np
import pytest
from conftest import one_sample, parameters
from flint import arb
from machines import newton_euler_equations, random_scene, with_legs

from stewart_crosscheck import analytic
from stewart_crosscheck.analytic import Leg, Parameters, PlatformMotion, SingularPose, forward_dynamics, stewart
from stewart_crosscheck.analytic.forward import FORMS, accelerations
from stewart_crosscheck.analytic.orientation import quaternion_from_cardan, rotation
from stewart_crosscheck.analytic.samples import BLOCK
from stewart_crosscheck.analytic.solve import conditioned, longest_lever, solve_numbers
from stewart_crosscheck.crosscheck.certainty import certain_forward
from stewart_crosscheck.crosscheck.engine import DynamicsResult, load_engine
from stewart_crosscheck.crosscheck.engines.analytic_ import _motion
from stewart_crosscheck.crosscheck.engines.reference_ import certified
from stewart_crosscheck.crosscheck.hard import load_family
from stewart_crosscheck.crosscheck.outcome import NEAR_SENSITIVITY, Place
from stewart_crosscheck.crosscheck.trajectory import POSE, RATES, Trajectory, from_file, from_scene
from stewart_crosscheck.models import Scene

ROUND_OFF = 2e-13
"""Relative error of accelerations: driving forces rounded to 1e-16 of each, which is up to 1e-14 of their sum's part
that accelerates (measured: hexapod 1.1e-14, random machines of condition below 60 up to 2e-14)."""


def error(got: Any, motion: PlatformMotion) -> float:
    """Largest relative error of ddC_p and dw_p."""
    pairs = ((got.ddC_p, motion.ddC_p), (got.dw_p, motion.dw_p))
    return max(float(np.abs(np.array(a) - b).max() / np.abs(b).max()) for a, b in pairs)


def as_balls(v: Any) -> Any:
    """Numbers, vectors and parameters as exact balls: float parameters among themselves would round."""
    if dataclasses.is_dataclass(v):
        return dataclasses.replace(v, **{f.name: as_balls(getattr(v, f.name)) for f in dataclasses.fields(v)})  # type: ignore[type-var]
    return tuple(as_balls(x) for x in v) if isinstance(v, (list, tuple)) else arb(v)


@pytest.fixture
def bits_200() -> Iterator[None]:
    before, flint.ctx.prec = flint.ctx.prec, 200
    yield
    flint.ctx.prec = before


def in_balls(P: Parameters, motion: PlatformMotion, F: Any, form: str) -> stewart.SecondProblem:
    motion = motion._replace(ddC_p=None, dw_p=None)
    return stewart.second_problem(as_balls(P), motion, F, lambda x: x.sqrt(), solve_numbers, FORMS[form].equations)


# --- The certified reference ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", FORMS)
def test_certified_forces_give_the_motion_back(
    form: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult, conditions: list[np.ndarray]
) -> None:
    got = forward_dynamics(parameters(hexapod), trajectory.motion, truth.F, form)
    assert error(got, trajectory.motion) < ROUND_OFF
    assert conditions[0].max() < 20  # measured 6.6, 1.4, 12.6


@pytest.mark.parametrize("backend", [None, "numpy", "float", "compiled"])
def test_certified_forces_give_the_motion_back_on_every_back_end(
    backend: str | None, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult, conditions: list[np.ndarray]
) -> None:
    got = forward_dynamics(parameters(hexapod), trajectory.motion, truth.F, backend=backend)
    assert error(got, trajectory.motion) < ROUND_OFF
    assert not conditions  # beyond doubt everywhere


@pytest.mark.parametrize("backend", ["numpy", "float", "compiled"])
@pytest.mark.parametrize(("steep", "digits"), [(1e-2, 1e-11), (1e-4, 1e-9)])
def test_steep_legs_are_left_to_the_form_that_serves_them(
    backend: str, steep: float, digits: float, hexapod: Scene, trajectory: Trajectory, conditions: list[np.ndarray]
) -> None:
    """A leg at rest, nearly along its base axis: the answer of every back end is that of the compliance form."""
    P = parameters(hexapod)
    rest = PlatformMotion(*(np.array(a[:3]) for a in trajectory.motion))
    rest.dC_p[:], rest.w_p[:] = 0.0, 0.0
    up = np.array([steep, np.sqrt(1.0 - steep * steep), 0.0])
    rest.C_p[1] = np.array(P.O[2]) - rest.R[1] @ P.p[2] + up
    F = np.full((3, 6), 50.0)
    got = forward_dynamics(P, rest, F, backend=backend)
    assert conditions
    wanted = forward_dynamics(P, rest, F, "compliance")
    np.testing.assert_allclose(got.ddC_p, wanted.ddC_p, rtol=0, atol=digits * np.abs(wanted.ddC_p).max())
    np.testing.assert_allclose(got.dw_p, wanted.dw_p, rtol=0, atol=digits * np.abs(wanted.dw_p).max())


@pytest.mark.parametrize("backend", ["numpy", "float", "compiled"])
def test_accelerations_that_overflow_are_named(backend: str, hexapod: Scene, trajectory: Trajectory) -> None:
    F = np.zeros((len(trajectory.t), 6))
    F[3] = 1e308
    with pytest.raises(ValueError, match="sample 3: accelerations are beyond what float64 holds"):
        forward_dynamics(parameters(hexapod), trajectory.motion, F, backend=backend)


def test_a_form_is_asked_for_without_a_back_end(hexapod: Scene, trajectory: Trajectory) -> None:
    F = np.zeros((len(trajectory.t), 6))
    with pytest.raises(ValueError, match="backend: got 'numpy' together with the form 'paper', expected one of them"):
        forward_dynamics(parameters(hexapod), trajectory.motion, F, "paper", "numpy")


@pytest.mark.parametrize("legs", [1, 3, 8, 12])
@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_any_number_of_legs_on_every_back_end(backend: str, legs: int, hexapod: Scene, trajectory: Trajectory) -> None:
    P = parameters(hexapod)
    which = [k % 6 for k in range(legs)]
    machine = dataclasses.replace(P, p=tuple(P.p[k] for k in which), O=tuple(P.O[k] for k in which))
    F = np.random.default_rng(1).normal(size=(len(trajectory.t), legs)) * 50.0
    got = forward_dynamics(machine, trajectory.motion, F, backend=backend)
    wanted = forward_dynamics(machine, trajectory.motion, F, "compliance")
    np.testing.assert_allclose(got.ddC_p, wanted.ddC_p, rtol=0, atol=ROUND_OFF * np.abs(wanted.ddC_p).max())
    np.testing.assert_allclose(got.dw_p, wanted.dw_p, rtol=0, atol=ROUND_OFF * np.abs(wanted.dw_p).max())


@pytest.mark.parametrize("seed", range(8))
def test_random_machines_give_the_motion_back(seed: int) -> None:
    """With and without bases, under inclined gravity and a load."""
    scene = random_scene(seed, base=seed % 2 == 0, gravity=(3.0, -8.0, 2.0))
    assert scene.load is not None
    trajectory = from_scene(scene, 3)
    F = load_engine("reference")(scene).inverse_dynamics(trajectory).F
    for form in FORMS:
        assert error(forward_dynamics(parameters(scene), trajectory.motion, F, form), trajectory.motion) < ROUND_OFF


@pytest.mark.parametrize("base", [True, False])
def test_in_balls_every_form_is_exact(base: bool, bits_200: None) -> None:
    """200 bits: reference, compliance, reduced and paper's form agree to 40 digits."""
    scene = random_scene(3, base=base, gravity=(3.0, -8.0, 2.0))
    tr = from_scene(scene, 3)
    names = ("position", "quaternion", "velocity", "angular_velocity", "acceleration", "angular_acceleration")
    row = {name: getattr(tr, name)[1].tolist() for name in names}
    F = certified(scene, row, bound=1e-50)["F"]
    balls = {name: as_balls(v) for name, v in row.items()}
    motion = PlatformMotion(
        balls["position"], rotation(balls["quaternion"]), balls["velocity"], balls["angular_velocity"], None, None
    )
    for form in FORMS:
        one = in_balls(parameters(scene), motion, F, form)
        for got, want in zip(
            (*one.ddC_p, *one.dw_p), (*row["acceleration"], *row["angular_acceleration"]), strict=True
        ):
            assert float(abs(got - want).upper()) < 1e-40


@pytest.mark.parametrize("base", [True, False])
def test_joint_accelerations(base: bool) -> None:
    """q'' that the paper's form solves for are those of the legs' kinematics."""
    scene = random_scene(2, base=base)
    tr = from_scene(scene, 3)
    motion = one_sample(tr.motion, 1)
    F = analytic.driving_forces(parameters(scene), tr.motion)[1].tolist()
    unknowns = accelerations(parameters(scene), motion, F, "paper").unknowns
    k = analytic.inverse_kinematics(parameters(scene), tr.motion)
    want = np.stack([k.ddq_o[1], k.ddq_n[1], k.ddq_s[1]], axis=1)
    np.testing.assert_allclose(np.reshape(unknowns[6:], (6, 3)), want, rtol=0, atol=ROUND_OFF * np.abs(want).max())


# --- Any number of legs: independent bodies ---------------------------------------------------------------------------


def body_residual(scene: Scene, motion: PlatformMotion, quaternion: Any, F: Any, file: Path) -> float:
    """How badly accelerations and F violate Newton-Euler of all bodies, of the largest force.

    With F_s . y_n = F the equations of `machines` are six more than their unknown reactions.
    """
    values = (0.0, *motion.C_p, *quaternion, *motion.dC_p, *motion.w_p, *motion.ddC_p, *motion.dw_p)
    file.write_text(",".join((*POSE, *RATES)) + "\n" + ",".join(map(repr, map(float, values))) + "\n")
    A, b, ys = newton_euler_equations(scene, from_file(scene, file), 0)
    known = np.zeros((scene.N, A.shape[1]))
    for i, y in enumerate(ys):
        known[i, 21 * i + 15 : 21 * i + 18] = y  # force of the rod joint
    A, b = np.vstack([A, known]), np.concatenate([b, F])
    x = np.linalg.lstsq(A, b)[0]
    return float(np.abs(A @ x - b).max() / np.abs(b).max())


@pytest.mark.parametrize("N", [1, 3, 4, 7, 8])
@pytest.mark.parametrize("form", FORMS)
def test_any_number_of_legs(form: str, N: int, tmp_path: Path) -> None:
    """Random forces: the accelerations satisfy Newton and Euler for every body."""
    whole = random_scene(N, gravity=(3.0, -8.0, 2.0))
    scene, tr = with_legs(whole, N), from_scene(whole, 3)
    motion = one_sample(tr.motion, 1)
    F = np.random.default_rng(N).uniform(-100, 100, N)
    one = accelerations(parameters(scene), motion, F.tolist(), form)
    moved = motion._replace(ddC_p=one.ddC_p, dw_p=one.dw_p)
    file = tmp_path / "row.csv"
    # measured 1e-15 to 1e-14: rounding of some 150 equations, moments about the world's origin
    assert body_residual(scene, moved, tr.unit_quaternion[1], F, file) < 1e-12
    wrong = moved._replace(dw_p=stewart.add(one.dw_p, (1e-6, 0.0, 0.0)))
    assert body_residual(scene, wrong, tr.unit_quaternion[1], F, file) > 1e-10


# --- Singular poses ---------------------------------------------------------------------------------------------------


def symmetric(yaw: float) -> tuple[Parameters, PlatformMotion]:
    """A hexapod whose platform, turned by 90 degrees of yaw, is in a parallel singularity."""
    ring = lambda r, shift: tuple(  # noqa: E731
        (r * math.cos(a), 0.0, r * math.sin(a))
        for i in range(6)
        for a in [math.pi / 3 * (i - i % 2) + (1 if i % 2 else -1) * shift + (i % 2) * math.pi / 3]
    )
    leg = Leg(m_n=3.0, a_n=0.2, J_nx=0.2, J_ny=0.01, m_s=2.0, a=0.3, J_sx=0.1, J_sz=0.004, m_o=1.0, J_oz=0.01)
    I_p = ((1.3, 0.05, 0.0), (0.05, 2.4, 0.1), (0.0, 0.1, 1.5))
    P = Parameters(leg, 27.0, I_p, ring(0.4, 0.2), ring(0.9, 0.4))
    R = rotation(quaternion_from_cardan([0.0, yaw, 0.0]).tolist())
    return P, PlatformMotion((0.0, 0.95, 0.0), R, (0.1, -0.2, 0.15), (0.3, -0.4, 0.2), stewart.ZERO, stewart.ZERO)


@pytest.mark.parametrize("delta", [1e-1, 1e-4, 1e-8, 0.0])
def test_a_parallel_singularity_is_regular(delta: float, bits_200: None) -> None:
    """No inverse dynamics there, but the accelerations under given forces: error as anywhere else."""
    P, motion = symmetric(math.pi / 2 + delta)
    F = [30.0, -20.0, 110.0, 50.0, 60.0, -70.0]
    legs = stewart.held_legs(P, motion, math.sqrt)[1]
    J = np.array([stewart.screw(k, k.y_n) for k in legs]).T
    assert conditioned(J[None], longest_lever(P.p))[1][0] > 1.0 / (
        delta + 1e-13
    )  # of (7), (8): the pose is what it should be
    exact = [in_balls(P, PlatformMotion(*map(as_balls, motion)), as_balls(F), form) for form in FORMS]
    for one in exact[1:]:
        for a, b in zip((*one.ddC_p, *one.dw_p), (*exact[0].ddC_p, *exact[0].dw_p), strict=True):
            assert float(abs(a - b).upper()) < 1e-40
    want = motion._replace(ddC_p=[float(x) for x in exact[0].ddC_p], dw_p=[float(x) for x in exact[0].dw_p])
    for form in FORMS:
        # the paper's form cancels products of q_o', q_n' with up to 40 rad/s^2: a factor 10 of round-off
        assert error(accelerations(P, motion, F, form), want) < ROUND_OFF


def steep(s: float, spins: bool, moving: bool) -> tuple[Parameters, PlatformMotion]:
    """A random machine whose first leg has sin q_n = s, and, moving, a base rate q_o' of about 1 rad/s."""
    scene = random_scene(4)
    P, motion = parameters(scene), one_sample(from_scene(scene, 3).motion, 1)
    if not spins:
        P = dataclasses.replace(P, leg=dataclasses.replace(P.leg, J_oz=0.0, J_ny=0.0, J_sz=0.0))
    tip = stewart.add(motion.C_p, stewart.apply(motion.R, P.p[0]))
    y_n, z_n = (-0.6 * s, math.sqrt(1 - s * s), 0.8 * s), (0.8, 0.0, 0.6)
    P = dataclasses.replace(P, O=(stewart.sub(tip, stewart.mul(0.9, y_n)), *P.O[1:]))
    if not moving:
        return P, motion._replace(dC_p=stewart.ZERO, w_p=stewart.ZERO)
    if not spins:  # any velocity of the tip is possible: here some 2 rad/s along x_n and z_n
        motion = motion._replace(dC_p=(1.5, 0.5, -2.0))
    else:
        r = stewart.sub(tip, motion.C_p)
        across = stewart.dot(z_n, stewart.add(motion.dC_p, stewart.cross(motion.w_p, r)))
        motion = motion._replace(dC_p=stewart.add(motion.dC_p, stewart.mul(0.9 * s - across, z_n)))
    return P, motion


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize(
    ("form", "spins", "s", "bound"),
    # Bounds: round-off as anywhere, ROUND_OFF, or a multiple of eps/s (spin, direction z_n of a rounded l),
    # eps/s^2 (reduced, stiff; moving, q_o' = V . z_n / s); paper without spin: q_o'' ~ 1/s^2 times s cancels.
    [
        *(("compliance", True, s, 1e-14 / s) for s in (1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10)),
        *(("paper", True, s, 1e-13 / s) for s in (1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10)),
        *(("reduced", True, s, 1e-14 / s**2) for s in (1e-1, 1e-2, 1e-4)),
        *(("compliance", False, s, ROUND_OFF) for s in (1e-1, 1e-4, 1e-8, 1e-12, 0.0)),
        *(("reduced", False, s, ROUND_OFF) for s in (1e-1, 1e-4, 1e-8, 1e-12, 0.0)),
        *(("paper", False, s, 1e-15 / s) for s in (1e-1, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10)),
    ],
)
def test_steep_legs(form: str, spins: bool, s: float, bound: float, moving: bool, bits_200: None) -> None:
    P, motion = steep(s, spins, moving)
    F = [30.0, -20.0, 110.0, 50.0, 60.0, -70.0]
    exact = in_balls(P, PlatformMotion(*map(as_balls, motion)), as_balls(F), "compliance")
    want = motion._replace(ddC_p=[float(x) for x in exact.ddC_p], dw_p=[float(x) for x in exact.dw_p])
    if moving and s < 1e-6 and spins:
        with pytest.raises(SingularPose, match="leg 1: sin q_n"):
            accelerations(P, motion, F, form)
    else:
        assert error(accelerations(P, motion, F, form), want) < max(bound, ROUND_OFF)


@pytest.mark.parametrize("seed", range(3))
def test_legs_from_joint_coordinates(seed: int) -> None:
    """Joint coordinates of a closed mechanism give the leg of its pose; accelerations are those of q'' = 0."""
    scene = random_scene(seed)
    P, motion = parameters(scene), one_sample(from_scene(scene, 3).motion, 1)
    for k, O in zip(stewart.held_legs(P, motion, math.sqrt)[1], P.O, strict=True):
        h = stewart.HingeRates(dq_o=k.w / k.s, ddq_o=0.0, ddq_n=0.0, e=-k.dq_n * k.w)
        leg = stewart.leg_from_joints(P.leg, k.r, (k.so, k.co, k.s, k.c), k.q_s, (h.dq_o, k.dq_n, k.dq_s))
        for name in ("L", "x_n", "y_n", "z_n", "dq_n", "dq_s", "w"):
            np.testing.assert_allclose(getattr(leg, name), getattr(k, name), rtol=0, atol=1e-15)  # rounding
        np.testing.assert_allclose(stewart.loop_gap(leg, O, motion), 0.0, rtol=0, atol=2e-15)  # m, m/s
        assert (leg.ddq_s, *(getattr(stewart.hinge_rates(leg), n) for n in ("ddq_o", "ddq_n", "e"))) == pytest.approx(
            (0.0, 0.0, 0.0, h.e), abs=1e-14
        )  # rounding over s > 0.15
        used, printed = stewart.leg_loads(P.leg, leg, P.g), stewart.leg_loads_printed(P.leg, leg, h, P.g)
        np.testing.assert_allclose(used, printed, rtol=0, atol=1e-13)  # N of some 30 N


def test_a_vertical_leg_with_spin_inertia_at_rest_holds_its_tip(bits_200: None) -> None:
    """At s = 0 the compliance form is regular: the tip cannot leave the plane of the base, which is the limit's."""
    P, motion = steep(0.0, spins=True, moving=False)
    F = [30.0, -20.0, 110.0, 50.0, 60.0, -70.0]

    def solve(rows: Any, right: Any) -> Any:
        assert np.linalg.cond(np.array(rows)) < 1e4  # measured 2e2; s = 0 changes nothing
        return solve_numbers(rows, right)

    one = stewart.second_problem(P, motion, F, math.sqrt, solve, stewart.compliance_equations)
    k = one.legs[0]
    tip = stewart.add(one.ddC_p, stewart.cross(one.dw_p, k.r))
    assert abs(stewart.dot(tip, k.z_n)) < 1e-14 * np.linalg.norm(tip)  # rounding of three products
    # a leg at s -> 0 with the same base angle, q_o = 0: l = (-s L, c L, 0)
    s = 2.0**-20
    O = stewart.add(P.O[0], (s * k.L, 0.0, 0.0))
    near = dataclasses.replace(P, O=(O, *P.O[1:]))
    limit = accelerations(near, motion, F)
    want = motion._replace(ddC_p=np.array(one.ddC_p), dw_p=np.array(one.dw_p))
    assert 1e-12 < error(limit, want) < 20 * s  # the difference is the pose's, of order s


@pytest.mark.parametrize(
    ("form", "spins", "s"),
    [("compliance", True, 1e-13), ("compliance", True, 0.0), ("reduced", True, 1e-7), ("paper", False, 1e-13)],
)
def test_legs_too_steep_for_a_form_are_named(form: str, spins: bool, s: float) -> None:
    """The base angle is not determined by the pose, or fewer than four digits would be left."""
    P, motion = steep(s, spins, moving=False)
    message = (
        rf"sample 2, leg 1: sin q_n = .*, in the form '{form}' rounding grows by up to .*, expected at most 1e\+12"
    )
    three = PlatformMotion(*(np.stack([np.array(a)] * 3) for a in motion))
    three.C_p[:2] += 0.1
    with pytest.raises(SingularPose, match=message):
        forward_dynamics(P, three, np.zeros((3, 6)), form)
    with pytest.raises(SingularPose, match=message.replace("sample 2", "sample 0")):
        accelerations(P, motion, [0.0] * 6, form)


# --- The driver -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", FORMS)
def test_blocks_and_single_states_agree(form: str, hexapod: Scene) -> None:
    tr = from_scene(hexapod, BLOCK + 2)
    F = analytic.driving_forces(parameters(hexapod), tr.motion)
    many = forward_dynamics(parameters(hexapod), tr.motion, F, form)
    for k in (0, BLOCK - 1, BLOCK, BLOCK + 1):
        one = accelerations(parameters(hexapod), one_sample(tr.motion, k), F[k].tolist(), form)
        np.testing.assert_allclose((one.ddC_p, one.dw_p), (many.ddC_p[k], many.dw_p[k]), rtol=0, atol=1e-13)
        # two orders of operations; condition below 13, accelerations of about 1


def test_accelerations_of_the_motion_are_not_read(
    hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    motion = trajectory.motion._replace(ddC_p=np.nan, dw_p=np.nan)
    assert error(forward_dynamics(parameters(hexapod), motion, truth.F), trajectory.motion) < ROUND_OFF


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m, F: (m, F[:, :5]), r"F: got shape \(21, 5\), expected \(21, 6\): one force per sample and leg"),
        (lambda m, F: (m, np.where(np.arange(21)[:, None] == 7, np.nan, F)), "F: sample 7 is not finite"),
        (lambda m, F: (m._replace(w_p=m.w_p[:, :2]), F), r"motion\.w_p: got shape \(21, 2\), expected \(21, 3\)"),
    ],
)
def test_unusable_input_is_named(
    change: Callable, message: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    with pytest.raises(ValueError, match=message):
        forward_dynamics(parameters(hexapod), *change(trajectory.motion, truth.F))


def test_an_unknown_form_lists_the_known_ones(hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult) -> None:
    with pytest.raises(ValueError, match="form: got 'spd', expected one of compliance, reduced, paper"):
        forward_dynamics(parameters(hexapod), trajectory.motion, truth.F, "spd")


def test_a_leg_of_no_length_is_named(hexapod: Scene, trajectory: Trajectory) -> None:
    motion = one_sample(trajectory.motion, 0)
    pin = stewart.add(motion.C_p, stewart.apply(motion.R, parameters(hexapod).p[3]))
    P = dataclasses.replace(parameters(hexapod), O=(*parameters(hexapod).O[:3], pin, *parameters(hexapod).O[4:]))
    with pytest.raises(SingularPose, match=r"sample 0, leg 4: length = .*, below 9e-13 m: no leg is left"):
        accelerations(P, motion, [0.0] * 6)


def test_a_machine_without_mass_has_no_accelerations() -> None:
    """One leg and a platform without inertia: nothing resists a turn."""
    P, motion = symmetric(0.3)
    P = dataclasses.replace(P, I_p=((0.0,) * 3,) * 3, p=P.p[:1], O=P.O[:1])
    arrays = PlatformMotion(*(np.array(a)[None] for a in motion))
    for form in FORMS:
        with pytest.raises(ArithmeticError, match="no accelerations follow, because masses or moments of inertia"):
            forward_dynamics(P, arrays, np.zeros((1, 1)), form)
    nothing = dataclasses.replace(P, m_p=0.0, p=(stewart.ZERO,))
    with pytest.raises(ArithmeticError, match="row-scaled condition inf, above 1e\\+12"):
        accelerations(nothing, motion, [0.0])


# --- Every term can be caught -----------------------------------------------------------------------------------------


def flipped(index: int) -> Callable:
    """Of a function that gives a tuple: one part with the other sign."""
    return lambda f: (
        lambda *a: (
            type(v)(  # type: ignore[return-value]
                *(-x if j == index else x for j, x in enumerate(v))
            )
            if hasattr(v := f(*a), "_fields")
            else tuple(-x if j == index else x for j, x in enumerate(v))
        )
    )


def no_gyroscopic_moment(f: Callable) -> Callable:
    return lambda P, m: f(P, m._replace(w_p=stewart.ZERO))


@pytest.mark.parametrize(
    ("name", "breaking", "forms"),
    [
        ("tip_inertia", flipped(0), ("compliance", "reduced")),
        ("tip_inertia", flipped(1), ("compliance", "reduced")),
        ("tip_inertia", flipped(2), ("compliance", "reduced")),
        ("joint_inertia", flipped(0), ("paper",)),
        ("joint_inertia", flipped(1), ("paper",)),
        ("joint_inertia", flipped(2), ("paper",)),
        ("platform_forces", no_gyroscopic_moment, tuple(FORMS)),
        ("outside_wrench", lambda f: lambda P, m: (stewart.ZERO, stewart.ZERO), tuple(FORMS)),
        ("leg_loads", lambda f: lambda leg, k, g: f(leg, k, stewart.ZERO), ("compliance", "reduced")),
        ("leg_loads_printed", lambda f: lambda leg, k, h, g: f(leg, k, h, stewart.ZERO), ("paper",)),
        ("loop_rows", lambda f: lambda legs: [[-x for x in row[:6]] + row[6:] for row in f(legs)], ("paper",)),
    ],
)
def test_a_wrong_term_shows(
    name: str, breaking: Callable, forms: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = random_scene(0)
    tr = from_scene(scene, 3)
    F = analytic.driving_forces(parameters(scene), tr.motion)
    assert max(error(forward_dynamics(parameters(scene), tr.motion, F, form), tr.motion) for form in forms) < ROUND_OFF
    monkeypatch.setattr(stewart, name, breaking(getattr(stewart, name)))
    for form in forms:
        assert error(forward_dynamics(parameters(scene), tr.motion, F, form), tr.motion) > 1e-4


@pytest.mark.parametrize("form", FORMS)
def test_a_fast_motion_is_no_steep_leg(form: str, hexapod: Scene, trajectory: Trajectory) -> None:
    """A hundred million times faster, accelerations grow with the square of it: nothing is lost."""
    m, k, F = trajectory.motion, 1e8, np.full((len(trajectory.t), 6), 50.0)
    slow = forward_dynamics(parameters(hexapod), m._replace(dC_p=0 * m.dC_p, w_p=0 * m.w_p), F, form)
    fast = forward_dynamics(parameters(hexapod), m._replace(dC_p=k * m.dC_p, w_p=k * m.w_p), F, form)
    once = forward_dynamics(parameters(hexapod), m, F, form)
    for name in ("ddC_p", "dw_p"):  # accelerations are affine in the square of the speed
        of_speed = getattr(once, name) - getattr(slow, name)
        np.testing.assert_allclose(getattr(fast, name) / k**2, of_speed, atol=1e-10 * np.abs(of_speed).max())


@pytest.mark.parametrize("length", [2e-3, 1e-4, 1e-5])
def test_a_short_leg_is_left_to_the_form_that_holds_it(length: float) -> None:
    """It is stiff across as 1/L^2 where its force has been eliminated; the paper's equations keep it apart."""
    case = next(c for c in load_family("motion") if c.name == "motion_short")
    point = case.at(length)
    truth = certain_forward(point)
    place = Place.of(point, truth)
    errors = {}
    for form in (None, "compliance"):
        a = forward_dynamics(parameters(point.scene), _motion(point.row), np.array([point.forces]), form)
        off = np.linalg.norm(a.ddC_p[0] - place.exact("a")[0]) / place.size.of("a")
        errors[form] = off / place.sensitivity("a")
    assert errors[None] < NEAR_SENSITIVITY
    assert (errors["compliance"] > NEAR_SENSITIVITY) == (length < 1e-3)


def test_a_form_refuses_the_leg_that_is_too_short_for_it() -> None:
    point = next(c for c in load_family("motion") if c.name == "motion_short").at(1e-7)
    with pytest.raises(SingularPose, match=r"leg 1: length = .*in the form 'compliance' rounding grows by up to"):
        forward_dynamics(parameters(point.scene), _motion(point.row), np.array([point.forces]), "compliance")
