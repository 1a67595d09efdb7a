"""The text of the formulas: printed lines against the forms in use, identities, kinds of numbers, errors."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from conftest import parameters
from flint import arb
from hypothesis import given, settings
from hypothesis import strategies as st
from machines import dense_newton_euler, random_scene

from stewart_crosscheck import analytic
from stewart_crosscheck.analytic import Leg, NotDeterminate, Parameters, PlatformMotion, SingularPose, stewart
from stewart_crosscheck.analytic.samples import BLOCK
from stewart_crosscheck.analytic.solve import solve_numbers, solve_samples
from stewart_crosscheck.crosscheck.engine import DynamicsResult, quantity
from stewart_crosscheck.crosscheck.trajectory import Trajectory, from_scene
from stewart_crosscheck.models import Scene

SEEDS = range(8)


def first_problem(P: Parameters, motion: PlatformMotion) -> stewart.FirstProblem:
    return stewart.first_problem(P, motion, math.sqrt, solve_numbers)


def random_state(seed: int, **how) -> tuple[Parameters, PlatformMotion]:
    """Parameters and one sample as plain floats."""
    scene = random_scene(seed, **how)
    motion = from_scene(scene, 3).motion
    return parameters(scene), PlatformMotion(*(np.asarray(a)[1].tolist() for a in motion))


def force_scale(one: stewart.FirstProblem) -> float:
    return max(float(np.linalg.norm(v)) for f in one.forces for v in f)


# --- Printed lines ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_printed_loads_equal_the_used_ones(seed: int) -> None:
    """(2)-(4) in any gravity."""
    P, motion = random_state(seed, gravity=(3.0, -8.0, 2.0))
    one = first_problem(P, motion)
    for k in one.legs:
        used = stewart.leg_loads(P.leg, k, P.g)
        printed = stewart.leg_loads_printed(P.leg, k, stewart.hinge_rates(k), P.g)
        np.testing.assert_allclose(printed, used, rtol=0, atol=1e-13 * force_scale(one))  # rounding


@pytest.mark.parametrize("seed", SEEDS)
def test_scalar_loads_equal_the_vector_ones(seed: int) -> None:
    """(20)-(22) in vertical gravity."""
    P, motion = random_state(seed)
    one = first_problem(P, motion)
    for k in one.legs:
        used = stewart.leg_loads(P.leg, k, P.g)
        scalar = stewart.leg_loads_scalar(P.leg, k, stewart.hinge_rates(k), P.g)
        np.testing.assert_allclose(scalar, used, rtol=0, atol=1e-13 * force_scale(one))  # rounding


def test_scalar_loads_refuse_inclined_gravity() -> None:
    P, motion = random_state(0)
    k = first_problem(P, motion).legs[0]
    with pytest.raises(
        ValueError, match=r"\(20\)-\(22\) hold for gravity along -y_r only, got g = \(0.1, -9.81, 0.0\)"
    ):
        stewart.leg_loads_scalar(P.leg, k, stewart.hinge_rates(k), (0.1, -9.81, 0.0))


@pytest.mark.parametrize("seed", SEEDS)
def test_scalar_6_by_6_system_equals_the_vector_form(seed: int) -> None:
    """(7)-(14) as printed, moments by O - C_p, against levers R p_i."""
    P, motion = random_state(seed)
    legs, loads, _ = stewart.determined(P, motion, math.sqrt)
    rows, right = stewart.platform_equations(P, motion, legs, loads)
    rows_printed, right_printed = stewart.platform_equations_printed(P, motion, legs, loads)
    np.testing.assert_allclose(rows_printed, rows, rtol=0, atol=1e-14)  # direction cosines and levers of about 1 m
    scale = force_scale(first_problem(P, motion))
    np.testing.assert_allclose(right_printed, right, rtol=0, atol=1e-13 * scale)  # sums of some ten forces
    X, X_printed = solve_numbers(rows, right), solve_numbers(rows_printed, right_printed)
    np.testing.assert_allclose(X_printed, X, rtol=0, atol=1e-12 * scale)  # condition below 60


@pytest.mark.parametrize("seed", SEEDS)
def test_printed_reactions_equal_the_used_ones(seed: int) -> None:
    """(23)-(29) in any gravity."""
    P, motion = random_state(seed, gravity=(-2.0, -9.0, 4.0))
    one = first_problem(P, motion)
    loads = [stewart.leg_loads(P.leg, k, P.g) for k in one.legs]
    for k, load, F, forces, moments in zip(one.legs, loads, one.F, one.forces, one.moments, strict=True):
        h = stewart.hinge_rates(k)
        tight = {"rtol": 0, "atol": 1e-13 * force_scale(one)}  # rounding; arms of about 1 m
        np.testing.assert_allclose(stewart.joint_forces_printed(P.leg, k, h, load, F, P.g), forces, **tight)
        np.testing.assert_allclose(stewart.joint_moments_printed(P.leg, k, h, load, P.g), moments, **tight)


@pytest.mark.parametrize("seed", SEEDS)
def test_lever_of_the_loop_closure(seed: int) -> None:
    """(19): L y_n + O - C_p = R p."""
    P, motion = random_state(seed)
    for k, O in zip(first_problem(P, motion).legs, P.O, strict=True):
        np.testing.assert_allclose(stewart.lever_printed(k, O, motion.C_p), k.r, rtol=0, atol=1e-15)  # m, 3 roundings


@pytest.mark.parametrize("seed", SEEDS)
def test_momentum_rate_in_principal_axes(seed: int) -> None:
    """(I_p w)' by direction cosines of the principal axes and their rates, as the text under (8) has it."""
    P, motion = random_state(seed)
    moments, V = np.linalg.eigh(np.array(P.I_p))
    axes = np.array(motion.R) @ V  # columns x_p, y_p, z_p in the world
    w, dw = np.array(motion.w_p), np.array(motion.dw_p)
    pqr, dpqr = axes.T @ w, axes.T @ dw
    daxes = np.cross(w, axes.T).T
    printed = axes @ (moments * dpqr) + daxes @ (moments * pqr)
    used = stewart.platform_momentum_rate(P, motion)
    np.testing.assert_allclose(used, printed, rtol=0, atol=1e-13 * float(np.linalg.norm(printed)))  # rounding of eigh


# --- Identities -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_identities_of_the_joints(seed: int) -> None:
    """F_s . y_n = F, M_n . z_n = 0, M_o . y_r = 0, (30), the projections of F_r."""
    P, motion = random_state(seed)
    one = first_problem(P, motion)
    scale = force_scale(one)
    for k, F, forces, moments in zip(one.legs, one.F, one.forces, one.moments, strict=True):
        load = stewart.leg_loads(P.leg, k, P.g)
        y, z = np.array(k.y_n), np.array(k.z_n)
        assert abs(forces.F_s @ y - F) < 1e-14 * scale  # rounding
        assert abs(moments.M_n @ z) < 1e-15 * scale
        assert abs(moments.M_o[1]) < 1e-15 * scale
        y_x_F_r = np.array(stewart.in_world(k, load.M_io_s / k.L, 0.0, load.M_in / k.L))
        np.testing.assert_allclose(np.cross(y, forces.F_r), y_x_F_r, rtol=0, atol=1e-14 * scale)
        axes = np.array([k.x_n, k.y_n, k.z_n])
        np.testing.assert_allclose(
            axes @ forces.F_r, stewart.projections_of_F_r(k, load, F), rtol=0, atol=1e-14 * scale
        )


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_driving_forces_equal_dense_newton_euler(seed: int) -> None:
    """Formulas against the dense Newton-Euler of the tests on any random hexapod."""
    scene = random_scene(seed)
    trajectory = from_scene(scene, 3)
    dense = dense_newton_euler(scene, trajectory, 1)
    F = analytic.driving_forces(parameters(scene), trajectory.motion)[1]
    # The dense system has condition up to 1e4 here: moments about the world origin.
    np.testing.assert_allclose(F, dense["F"], rtol=0, atol=1e-11 * np.abs(dense["F_o"]).max())


@pytest.mark.parametrize("seed", range(3))
def test_the_other_branch_gives_the_same_forces(seed: int) -> None:
    """(q_o + pi, -q_n): s, so, co change sign, and with them x_n, z_n, the hinge rates q_n', w."""
    P, motion = random_state(seed)
    one = first_problem(P, motion)
    for k, load, moments in zip(one.legs, *stewart.determined(P, motion, math.sqrt)[1:], strict=True):
        negate = lambda v: tuple(-x for x in v)  # noqa: E731
        other = k._replace(
            s=-k.s, so=-k.so, co=-k.co, x_n=negate(k.x_n), z_n=negate(k.z_n), dq_n=-k.dq_n, w=-k.w, u=-k.u, nu=-k.nu
        )
        load_ = stewart.leg_loads(P.leg, other, P.g)
        assert load_.F_is == load.F_is
        assert (load_.M_in, load_.M_io_s) == (-load.M_in, -load.M_io_s)  # along -z_n, -x_n: the same vectors
        for a, b in zip(stewart.joint_moments(P.leg, other, load_), moments, strict=True):
            np.testing.assert_array_equal(np.array(a) + 0.0, np.array(b) + 0.0)


# --- Every formula can be caught --------------------------------------------------------------------------------------


def _replaced(name: str) -> Callable[[Parameters], Parameters]:
    """A leg parameter changed by a factor."""
    return lambda P: dataclasses.replace(P, leg=dataclasses.replace(P.leg, **{name: getattr(P.leg, name) * (1 + 1e-6)}))


@pytest.mark.parametrize("field", [f.name for f in dataclasses.fields(Leg)])
def test_every_leg_parameter_moves_some_reaction(field: str) -> None:
    """No parameter is dead: a relative change of 1e-6 shows six digits above the rounding."""
    P, motion = random_state(1)
    before, after = first_problem(P, motion), first_problem(_replaced(field)(P), motion)
    change = max(
        np.abs(np.array(a) - np.array(b)).max()
        for x, y in ((before.forces, after.forces), (before.moments, after.moments))
        for a, b in zip(x, y, strict=True)
    )
    assert change > 1e-10 * force_scale(before)


# --- Numbers of every kind --------------------------------------------------------------------------------------------


def test_floats_arrays_and_balls_give_the_same(
    hexapod: Scene, trajectory: Trajectory, samples_as_floats: list[PlatformMotion]
) -> None:
    P = parameters(hexapod)
    D = analytic.inverse_dynamics(P, trajectory.motion)
    scale = np.abs(D.F_o).max()
    for k in (0, 7, 20):
        one = first_problem(P, samples_as_floats[k])
        balls = PlatformMotion(*(_as_balls(v) for v in samples_as_floats[k]))
        ball = stewart.first_problem(P, balls, lambda x: x.sqrt(), solve_numbers)
        np.testing.assert_allclose(one.F, D.F[k], rtol=0, atol=1e-14 * scale)  # two solvers, condition below 8
        np.testing.assert_allclose([float(F) for F in ball.F], D.F[k], rtol=0, atol=1e-13 * scale)  # 53-bit balls
        for name, values in zip(stewart.Forces._fields, zip(*one.forces, strict=True), strict=True):
            np.testing.assert_allclose(values, getattr(D, name)[k], rtol=0, atol=1e-14 * scale)
        for name, values in zip(stewart.Moments._fields, zip(*one.moments, strict=True), strict=True):
            np.testing.assert_allclose(values, getattr(D, name)[k], rtol=0, atol=1e-14 * scale)


def _as_balls(v):
    return [_as_balls(x) for x in v] if isinstance(v, list) else arb(v)


def test_long_double_has_three_digits_more(hexapod: Scene, samples_as_floats: list[PlatformMotion]) -> None:
    """The same text and solver on NumPy long doubles, against 53-bit floats: closer to 200-bit balls."""
    import flint

    motion, P = samples_as_floats[3], parameters(hexapod)
    if np.finfo(np.longdouble).nmant <= 52:
        pytest.skip("long double is double on this machine")
    long = PlatformMotion(*(np.array(v, dtype=np.longdouble) for v in motion))
    F_long = stewart.first_problem(P, long, np.sqrt, solve_numbers).F
    before, flint.ctx.prec = flint.ctx.prec, 200
    try:
        F = stewart.first_problem(
            P, PlatformMotion(*(_as_balls(v) for v in motion)), lambda x: x.sqrt(), solve_numbers
        ).F
        # a long double as a sum of two floats, both exact
        errors = [
            abs(arb(float(x)) + arb(float(x - np.longdouble(float(x)))) - f) for x, f in zip(F_long, F, strict=True)
        ]
    finally:
        flint.ctx.prec = before
    # measured 1.3e-19; plain floats 3.5e-16. Products of float parameters are so few that they do not show.
    assert max(float(e) for e in errors) < 1e-17 * max(abs(float(f)) for f in F)


def test_blocks_do_not_show(hexapod: Scene) -> None:
    """More samples than a block: every sample equals the one computed alone."""
    motion = from_scene(hexapod, 2 * BLOCK + 3).motion
    D = analytic.inverse_dynamics(parameters(hexapod), motion)
    for k in (0, BLOCK - 1, BLOCK, 2 * BLOCK + 2):
        alone = analytic.inverse_dynamics(
            parameters(hexapod), PlatformMotion(*(np.asarray(a)[k : k + 1] for a in motion))
        )
        for name in hexapod.quantities:
            np.testing.assert_allclose(
                getattr(alone, name)[0], getattr(D, name)[k], rtol=0, atol=1e-15 * np.abs(D.F_o).max()
            )  # vector units of arrays round like single numbers up to one bit


def test_agrees_with_truth(hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult) -> None:
    D = analytic.inverse_dynamics(parameters(hexapod), trajectory.motion)
    scale = np.abs(truth.reactions[..., 3:]).max()
    for name in hexapod.quantities:
        want = quantity(hexapod, name, truth.F, truth.reactions)
        got = getattr(D, name).reshape(want.shape)
        np.testing.assert_allclose(got, want, rtol=0, atol=3e-15 * scale)  # measured 1e-15: cond 8


# --- Far from the origin, small platform, steep legs ------------------------------------------------------------------


def test_a_world_offset_costs_nothing(hexapod: Scene, samples_as_floats: list[PlatformMotion]) -> None:
    """1e6 m away, coordinates rounded to exact multiples first: C_p - O is formed before R p is added."""
    P, motion = parameters(hexapod), samples_as_floats[2]
    grid = lambda v: tuple(round(x * 2**20) / 2**20 for x in v)  # noqa: E731  sums with 2^20 m stay exact
    shift = (2.0**20, -(2.0**20), 2.0**20)
    near = dataclasses.replace(P, O=tuple(grid(o) for o in P.O))
    far = dataclasses.replace(near, O=tuple(stewart.add(o, shift) for o in near.O))
    here = motion._replace(C_p=grid(motion.C_p))
    there = here._replace(C_p=stewart.add(here.C_p, shift))
    assert first_problem(far, there).F == first_problem(near, here).F


def test_a_small_platform_keeps_its_digits(hexapod: Scene, samples_as_floats: list[PlatformMotion]) -> None:
    """Pins scaled by 2^-20: levers R p keep 1e-14, the printed levers O - C_p + L y_n lose six digits."""
    P, motion = parameters(hexapod), samples_as_floats[2]
    r = 2.0**-20
    small = dataclasses.replace(
        P,
        p=tuple(stewart.mul(r, p) for p in P.p),
        I_p=tuple(stewart.mul(r * r, row) for row in P.I_p),
        load=stewart.Load(),
    )
    legs, loads, _ = stewart.determined(small, motion, math.sqrt)
    X, X_printed = (
        solve_samples([[np.array([x]) for x in row] for row in rows], [np.array([b]) for b in right], r)[0]
        for rows, right in (
            stewart.platform_equations(small, motion, legs, loads),
            stewart.platform_equations_printed(small, motion, legs, loads),
        )
    )
    balls = PlatformMotion(*(_as_balls(v) for v in motion))
    import flint

    before, flint.ctx.prec = flint.ctx.prec, 200
    try:
        legs_, loads_, _ = stewart.determined(small, balls, lambda x: x.sqrt())
        exact = [float(x) for x in solve_numbers(*stewart.platform_equations(small, balls, legs_, loads_))]
    finally:
        flint.ctx.prec = before
    scale = max(map(abs, exact))
    assert max(abs(a[0] - b) for a, b in zip(X, exact, strict=True)) < 1e-14 * scale  # measured 1e-15
    assert max(abs(a[0] - b) for a, b in zip(X_printed, exact, strict=True)) > 1e-12 * scale


def _vertical_leg(P: Parameters, motion: PlatformMotion, offset: float) -> Parameters:
    """Leg 1 moved under its platform pin, `offset` m aside."""
    tip = stewart.add(motion.C_p, stewart.apply(motion.R, P.p[0]))
    return dataclasses.replace(P, O=((tip[0] - offset, tip[1] - 0.9, tip[2]), *P.O[1:]))


@pytest.mark.parametrize("offset", [0.0, 1e-15, 1e-9, 1e-6])
def test_a_vertical_leg_without_spin_inertia_is_regular(offset: float, samples_as_floats: list, hexapod: Scene) -> None:
    """J_oz = J_y = 0: the force at s = 0 is the limit of the forces at s -> 0."""
    P, motion = parameters(hexapod), samples_as_floats[1]
    P = dataclasses.replace(P, leg=dataclasses.replace(P.leg, J_oz=0.0, J_ny=0.0, J_sz=0.0))
    F = analytic.driving_forces(_vertical_leg(P, motion, offset), _one(motion))[0]
    limit = analytic.driving_forces(_vertical_leg(P, motion, 1e-12), _one(motion))[0]
    np.testing.assert_allclose(
        F, limit, rtol=0, atol=(1e-13 + 10 * abs(offset - 1e-12)) * np.abs(limit).max()
    )  # dF/F ~ 1/m


def _one(motion: PlatformMotion) -> PlatformMotion:
    return PlatformMotion(*(np.array([v]) for v in motion))


def test_moments_without_spin_inertia_are_the_limit_of_small_ones(
    hexapod: Scene, samples_as_floats: list[PlatformMotion]
) -> None:
    P, motion = parameters(hexapod), samples_as_floats[1]
    none, little = (
        first_problem(dataclasses.replace(P, leg=dataclasses.replace(P.leg, J_oz=J, J_ny=J, J_sz=J)), motion)
        for J in (0.0, 1e-14)
    )
    for a, b in zip(none.moments, little.moments, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)  # N m: 1e-14 kg m^2 times accelerations of some ten


def test_a_leg_just_off_the_vertical_is_solved(hexapod: Scene, samples_as_floats: list[PlatformMotion]) -> None:
    """Refused below sin q_n = 1e-12, and not above: the force is huge, and told."""
    motion = samples_as_floats[1]
    F = analytic.driving_forces(_vertical_leg(parameters(hexapod), motion, 5e-12), _one(motion))
    assert np.isfinite(F).all()


def test_base_angles_are_continued_without_jumps(hexapod: Scene) -> None:
    """A leg that goes round the vertical: q_o runs through pi."""
    t = np.linspace(0.0, 1.0, 50)
    angle = 2 * np.pi * t
    zero = np.zeros((50, 3))
    O = np.array(parameters(hexapod).O[0])
    tip = np.array(parameters(hexapod).p[0])
    C_p = O + np.column_stack([0.1 * np.cos(angle), 0.9 + 0 * t, 0.1 * np.sin(angle)]) - tip
    motion = PlatformMotion(C_p, np.broadcast_to(np.eye(3), (50, 3, 3)), zero, zero, zero, zero)
    q_o = analytic.inverse_kinematics(parameters(hexapod), motion).q_o[:, 0]
    np.testing.assert_allclose(np.diff(q_o), np.diff(q_o)[0], rtol=1e-6)
    assert abs(q_o[-1] - q_o[0]) == pytest.approx(2 * np.pi)


# --- Errors -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("offset", [0.0, 1e-14])
def test_a_vertical_leg_with_base_inertia_is_refused(offset: float, hexapod: Scene, trajectory: Trajectory) -> None:
    motion = trajectory.motion
    P = _vertical_leg(parameters(hexapod), PlatformMotion(*(a[3] for a in motion)), offset)
    with pytest.raises(SingularPose, match=r"sample 3, leg 1: sin q_n = .*base or spin inertia") as e:
        analytic.inverse_dynamics(P, motion)
    assert (e.value.sample, e.value.leg) == (3, 1)
    assert e.value.value < 1e-12


def test_a_parallel_singularity_is_refused(hexapod: Scene, trajectory: Trajectory) -> None:
    """Pins of legs 2 and 5 at the same two points: their columns are equal."""
    P = parameters(hexapod)
    P = dataclasses.replace(P, p=(*P.p[:4], P.p[1], P.p[5]), O=(*P.O[:4], P.O[1], P.O[5]))
    with pytest.raises(SingularPose, match=r"sample \d+, leg [25]: condition .* above 1e\+12") as e:
        analytic.inverse_dynamics(P, trajectory.motion)
    assert e.value.value > 1e12


def test_the_singular_sample_is_named_across_blocks(hexapod: Scene) -> None:
    motion = from_scene(hexapod, BLOCK + 10).motion
    R = motion.R.copy()
    R[BLOCK + 4] = 0.0  # all levers vanish: no rotation, but a matrix of rank 3
    with pytest.raises(SingularPose, match=f"sample {BLOCK + 4}, "):
        analytic.inverse_dynamics(parameters(hexapod), motion._replace(R=R))


@pytest.mark.parametrize(("N", "kind"), [(5, "overdetermined: 1 too many"), (8, "underdetermined: 2 too many")])
def test_other_numbers_of_legs_say_what_is_determined(
    N: int, kind: str, hexapod: Scene, trajectory: Trajectory
) -> None:
    P = parameters(hexapod)
    pins = lambda rows: (*rows, stewart.mul(0.9, rows[0]), stewart.mul(0.8, rows[3]))[:N]  # noqa: E731
    other = dataclasses.replace(P, p=pins(P.p), O=pins(P.O))
    with pytest.raises(NotDeterminate, match=kind) as e:
        analytic.inverse_dynamics(other, trajectory.motion)
    six = analytic.inverse_dynamics(P, trajectory.motion)
    legs, loads, moments = e.value.determined
    assert len(legs) == len(loads) == len(moments) == N
    for i in range(min(N, 5)):  # the same pins: the same moments and the same transverse components of F_r
        few = 4e-15 * np.abs(six.M_s).max()  # roundings of another order of sums
        np.testing.assert_allclose(np.array(moments[i].M_s).T, six.M_s[:, i], rtol=0, atol=few)
        x_n = np.array(np.broadcast_arrays(*legs[i].x_n)).T
        np.testing.assert_allclose(
            np.sum(six.F_r[:, i] * x_n, axis=1), -loads[i].M_in / legs[i].L, rtol=0, atol=1e-13 * np.abs(six.F_o).max()
        )


@pytest.mark.parametrize(("field", "shape"), [("C_p", (4, 2)), ("R", (4, 3)), ("w_p", (3, 3))])
def test_wrong_shapes_are_named(field: str, shape: tuple[int, ...], hexapod: Scene) -> None:
    motion = PlatformMotion(*(np.zeros((4, 3, 3)) if n == "R" else np.zeros((4, 3)) for n in PlatformMotion._fields))
    with pytest.raises(ValueError, match=r"motion\.\w+: got shape .* expected"):
        analytic.inverse_dynamics(parameters(hexapod), motion._replace(**{field: np.zeros(shape)}))


@pytest.mark.parametrize("C_p", [np.zeros((0, 3)), np.array(1.0)])
def test_a_motion_without_samples_is_refused(C_p: np.ndarray, hexapod: Scene, trajectory: Trajectory) -> None:
    with pytest.raises(ValueError, match=r"motion\.C_p: got shape .* at least one sample"):
        analytic.inverse_dynamics(parameters(hexapod), trajectory.motion._replace(C_p=C_p))


def test_pins_must_come_in_pairs(hexapod: Scene) -> None:
    with pytest.raises(ValueError, match="got 5 platform pins p and 6 hull pins O"):
        dataclasses.replace(parameters(hexapod), p=parameters(hexapod).p[:5])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_not_finite_are_named(value: float, hexapod: Scene, trajectory: Trajectory) -> None:
    broken = trajectory.velocity.copy()
    broken[7, 1] = value
    with pytest.raises(ValueError, match=r"motion\.dC_p: sample 7 is not finite"):
        analytic.inverse_dynamics(parameters(hexapod), trajectory.motion._replace(dC_p=broken))
