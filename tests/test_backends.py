"""Back ends: one text, the same arrays, in every memory order and number of samples; doubt is never silent."""

from __future__ import annotations

import copy
import math
import threading
import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from conftest import one_sample, parameters
from flint import arb, ctx

from stewart_crosscheck import analytic
from stewart_crosscheck.analytic import (
    ControlLoop,
    Infeasible,
    InverseDynamics,
    NotDeterminate,
    PlatformMotion,
    SingularPose,
    backends,
    dynamics,
    evaluate,
    registers,
)
from stewart_crosscheck.analytic.compiled import Compiled
from stewart_crosscheck.analytic.evaluate import DRIVING_FORCES, FORWARD_DYNAMICS, INVERSE_DYNAMICS, Problem
from stewart_crosscheck.analytic.precision import KINDS, precise_driving_forces
from stewart_crosscheck.analytic.samples import BLOCK
from stewart_crosscheck.analytic.solve import LIMIT, ordered_numbers
from stewart_crosscheck.analytic.traced import traced
from stewart_crosscheck.crosscheck.engine import DynamicsResult, by_joint
from stewart_crosscheck.crosscheck.trajectory import Trajectory, from_scene
from stewart_crosscheck.models import Scene, load_scene, scene_names

BACKENDS = ("numpy", "float", "compiled")
ARRAYS = ("F", "F_r", "F_s", "F_n", "F_o", "M_s", "M_n", "M_o", "L", "dL")

F_ERROR, REACTION_ERROR = 2e-15, 1e-13
"""Of driving forces and of single reactions, over their norm: some ten roundings of sums of up to 300 N, times a
condition of up to 10; small reactions are differences of large ones."""

ROUNDING = 4e-15
"""Of the largest force, between back ends: two answers that are each within `F_ERROR` of the truth."""


def flat(one: PlatformMotion) -> list[float]:
    """Numbers of one sample, as a problem takes them."""
    return [float(x) for a in one for x in np.ravel(np.asarray(a))]


def repeated(motion: PlatformMotion, n: int) -> PlatformMotion:
    """So many samples of a motion, again and again, contiguous."""
    return PlatformMotion(*(np.ascontiguousarray(np.resize(a, (n, *a.shape[1:]))) for a in motion))


@pytest.mark.parametrize("backend", BACKENDS)
def test_every_back_end_is_as_exact_as_it_says(
    backend: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    assert trajectory.condition.max() < 10.5
    D = analytic.inverse_dynamics(hexapod.parameters, trajectory.motion, backend)
    F = analytic.driving_forces(hexapod.parameters, trajectory.motion, backend)
    for got in (D.F, F):
        error = np.linalg.norm(got - truth.F, axis=1) / np.linalg.norm(truth.F, axis=1)
        assert error.max() < F_ERROR
    got = by_joint(hexapod, vars(D)).reshape(-1, 3)
    true = truth.reactions.reshape(-1, 3)
    size = np.linalg.norm(true, axis=1)
    has = size > 0
    assert (np.linalg.norm(got - true, axis=1)[has] / size[has]).max() < REACTION_ERROR
    assert np.abs(got[~has]).max(initial=0.0) == 0.0  # a spherical joint transmits no moment


@pytest.mark.parametrize("name", scene_names())
def test_back_ends_are_equal_on_every_scene(name: str) -> None:
    scene = load_scene(name)
    motion = from_scene(scene, 31).motion
    one = {b: analytic.inverse_dynamics(scene.parameters, motion, b) for b in BACKENDS}
    size = np.abs(one["float"].F_r).max()
    for b in BACKENDS:
        for array in ARRAYS:
            unit = 1.0 if array in ("L", "dL") else size
            gap = np.abs(getattr(one[b], array) - getattr(one["float"], array)).max()
            assert gap < ROUNDING * unit, (b, array)
        assert np.array_equal(one[b].undetermined, one["float"].undetermined)
        assert np.abs(analytic.driving_forces(scene.parameters, motion, b) - one[b].F).max() < ROUNDING * size


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
@pytest.mark.parametrize("nt", [1, 2, 31, 33, BLOCK - 1, BLOCK + 1, Compiled.size + 5])
def test_no_sample_is_lost_between_blocks(backend: str, nt: int, hexapod: Scene, trajectory: Trajectory) -> None:
    P = hexapod.parameters
    few = analytic.inverse_dynamics(P, trajectory.motion, "float")
    D = analytic.inverse_dynamics(P, repeated(trajectory.motion, nt), backend)
    for array in ARRAYS:
        wanted = getattr(few, array)
        wanted = np.resize(wanted, (nt, *wanted.shape[1:]))
        assert getattr(D, array).shape == wanted.shape
        np.testing.assert_allclose(getattr(D, array), wanted, rtol=0, atol=ROUNDING * 335)


def test_a_single_sample_runs_on_floats_and_more_on_arrays(
    hexapod: Scene, trajectory: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    made = backends.back_end
    monkeypatch.setattr(backends, "back_end", lambda name, *a: (asked.append(name), made(name, *a))[1])
    analytic.driving_forces(hexapod.parameters, repeated(trajectory.motion, 1))
    analytic.driving_forces(hexapod.parameters, repeated(trajectory.motion, 2))
    assert asked == ["float", "numpy"]


@pytest.mark.parametrize("backend", BACKENDS)
def test_given_arrays_are_filled_whatever_their_order(backend: str, hexapod: Scene, trajectory: Trajectory) -> None:
    P, motion = hexapod.parameters, trajectory.motion
    F = analytic.driving_forces(P, motion, backend)
    nt, N = F.shape
    for out in (np.full((nt, N), np.nan), np.full((N, nt), np.nan).T, np.full((nt, 2 * N), np.nan)[:, ::2]):
        assert analytic.driving_forces(P, motion, backend, out) is out
        np.testing.assert_array_equal(out, F)
    D = InverseDynamics.zeros(nt, N)
    assert analytic.inverse_dynamics(P, motion, backend, D) is D
    np.testing.assert_array_equal(D.F, analytic.inverse_dynamics(P, motion, backend).F)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_motion_in_any_memory_order(backend: str, hexapod: Scene, trajectory: Trajectory) -> None:
    m = trajectory.motion
    other = PlatformMotion(*(np.asfortranarray(a) for a in m))
    thin = PlatformMotion(*(np.repeat(a, 2, axis=0)[::2] for a in m))
    F = analytic.driving_forces(hexapod.parameters, m, backend)
    for motion in (other, thin, PlatformMotion(*(a.tolist() for a in m))):
        np.testing.assert_array_equal(analytic.driving_forces(hexapod.parameters, motion, backend), F)


def test_wrong_arrays_are_refused(hexapod: Scene, trajectory: Trajectory) -> None:
    P, motion = hexapod.parameters, trajectory.motion
    with pytest.raises(ValueError, match=r"out: got float64 of shape \(3, 6\), expected float64 of shape \(21, 6\)"):
        analytic.driving_forces(P, motion, out=np.zeros((3, 6)))
    with pytest.raises(ValueError, match="out: got int64"):
        analytic.driving_forces(P, motion, out=np.zeros((21, 6), dtype=int))
    with pytest.raises(ValueError, match=r"out: got float64 of shape \(144, 5\), expected .* \(144, 21\)"):
        analytic.inverse_dynamics(P, motion, out=InverseDynamics.zeros(5, 6))
    with pytest.raises(ValueError, match=r"out: got ndarray, expected what InverseDynamics.zeros makes"):
        analytic.inverse_dynamics(P, motion, out=np.zeros((144, 21)))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="out: got a copy, whose arrays are no views"):
        analytic.inverse_dynamics(P, motion, out=copy.deepcopy(InverseDynamics.zeros(21, 6)))
    with pytest.raises(ValueError, match="out: got list, expected float64"):
        analytic.driving_forces(P, motion, out=[])  # type: ignore[arg-type]
    lists = replace(parameters(hexapod), p=[list(p) for p in parameters(hexapod).p])  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="P: got lists or arrays in it, expected numbers and tuples of numbers"):
        analytic.driving_forces(lists, motion)
    for odd in ("", ["numpy"]):
        with pytest.raises(ValueError, match=r"backend: got .*, expected one of numpy, float, compiled"):
            analytic.driving_forces(P, motion, odd)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="backend: got 'fast', expected one of numpy, float, compiled"):
        analytic.driving_forces(P, motion, "fast")


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("field", PlatformMotion._fields)
def test_what_is_not_finite_is_named(backend: str, field: str, hexapod: Scene, trajectory: Trajectory) -> None:
    nt, bad = (3, 1) if backend == "float" else (Compiled.size + 40, Compiled.size + 34)
    motion = repeated(trajectory.motion, nt)
    getattr(motion, field)[bad] = np.nan if field != "dw_p" else np.inf
    for call in (analytic.driving_forces, analytic.inverse_dynamics):
        with pytest.raises(ValueError, match=f"motion.{field}: sample {bad} is not finite"):
            call(hexapod.parameters, motion, backend)


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_overflows_is_named(backend: str, hexapod: Scene, trajectory: Trajectory) -> None:
    motion = repeated(trajectory.motion, 3)
    motion.w_p[1] = 1e200
    for call in (analytic.driving_forces, analytic.inverse_dynamics):
        with pytest.raises(ValueError, match="sample 1: forces or reactions are beyond what float64 holds"):
            call(hexapod.parameters, motion, backend)


@pytest.mark.parametrize("backend", BACKENDS)
def test_memory_that_can_not_be_filled_is_refused(backend: str, hexapod: Scene, trajectory: Trajectory) -> None:
    P, motion = hexapod.parameters, trajectory.motion
    fixed, whole = np.zeros((6, 21)).T, InverseDynamics.zeros(21, 6)
    fixed.setflags(write=False)
    whole.numbers.setflags(write=False)
    with pytest.raises(ValueError, match="out: got an array that can only be read"):
        analytic.driving_forces(P, motion, backend, fixed)
    with pytest.raises(ValueError, match="out: got an array that can only be read"):
        analytic.inverse_dynamics(P, motion, backend, whole)
    assert not fixed.any()
    both = np.zeros((21, 9))
    both[:, :3] = motion.ddC_p
    with pytest.raises(ValueError, match=r"out: shares its memory with motion.ddC_p"):
        analytic.driving_forces(P, motion._replace(ddC_p=both[:, :3]), backend, both[:, 3:])
    odd = np.ndarray((21, 6), float, bytearray(6 * 172 + 200), strides=(8, 172))  # rows of 21.5 numbers
    np.testing.assert_array_equal(
        analytic.driving_forces(P, motion, backend, odd), analytic.driving_forces(P, motion, backend)
    )


@pytest.mark.parametrize("backend", BACKENDS)
def test_machines_of_other_numbers_are_machines_of_floats(backend: str, hexapod: Scene, trajectory: Trajectory) -> None:
    """Numbers that are equal and less exact must not stand in for floats, here or for a later machine of floats."""
    P, motion = parameters(hexapod), trajectory.motion
    small = replace(P, m_p=np.float32(27.25), leg=replace(P.leg, m_s=np.float32(2.75), m_n=3))
    plain = replace(P, m_p=27.25, leg=replace(P.leg, m_s=2.75, m_n=3.0))
    assert small == plain
    first = analytic.driving_forces(small, motion, backend)
    np.testing.assert_array_equal(first, analytic.driving_forces(plain, motion, backend))
    backends.back_end.cache_clear()
    np.testing.assert_array_equal(first, analytic.driving_forces(plain, motion, backend))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"m_p": np.nan}, "P.m_p: got nan, expected a finite number"),
        ({"m_p": "3"}, "P.m_p: got '3', expected a finite number"),
        ({"g": (0.0, 1j, 0.0)}, "P.g: got 1j, expected a finite number"),
        ({"p": (), "O": ()}, "P: got no legs"),
    ],
)
def test_unusable_machines_are_named(
    change: dict[str, Any], message: str, hexapod: Scene, trajectory: Trajectory
) -> None:
    P, motion = replace(parameters(hexapod), **change), trajectory.motion
    with pytest.raises(ValueError, match=message):
        analytic.forward_dynamics(P, motion, np.zeros((21, len(P.p))))
    for call in (analytic.driving_forces, analytic.inverse_dynamics):
        with pytest.raises(ValueError, match=message):
            call(P, motion)
    with pytest.raises(ValueError, match=message):
        ControlLoop(P)


def test_unusable_motions_are_named(hexapod: Scene, trajectory: Trajectory) -> None:
    for wrong, kind in ((trajectory.motion.dC_p + 1j, "complex128"), (np.full((21, 3), "1"), "<U1")):
        with pytest.raises(ValueError, match=f"motion.dC_p: got {kind}, expected real numbers"):
            analytic.driving_forces(hexapod.parameters, trajectory.motion._replace(dC_p=wrong))


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_singular_pose_is_named_wherever_it_is(backend: str, hexapod: Scene, trajectory: Trajectory) -> None:
    nt, bad = (3, 1) if backend == "float" else (Compiled.size + 40, Compiled.size + 34)
    motion = repeated(trajectory.motion, nt)
    motion.R[bad] = 0.0  # all levers vanish: no rotation, but a matrix of rank 3
    with pytest.raises(SingularPose, match=f"sample {bad}, .*parallel singularity"):
        analytic.driving_forces(hexapod.parameters, motion, backend)
    motion = repeated(trajectory.motion, nt)
    P = parameters(hexapod)
    motion.C_p[bad] = np.array(P.O[2]) - motion.R[bad] @ P.p[2] + (0.0, 1.0, 0.0)  # leg 3 upright
    with pytest.raises(SingularPose, match=f"sample {bad}, leg 3: sin q_n"):
        analytic.driving_forces(P, motion, backend)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("turn", "solved"), [(1e-6, True), (1e-13, False)])
def test_doubt_is_looked_at_again(
    backend: str, turn: float, solved: bool, hexapod: Scene, trajectory: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Legs that nearly meet in C_p: solved with fewer digits or refused, carefully; easy poses never get there."""
    P = parameters(hexapod)
    close = replace(P, O=tuple((3.0 * x, 3.0 * y, 3.0 * z) for x, y, z in P.p))
    R = np.array([[1.0, -turn, turn], [turn, 1.0, -turn], [-turn, turn, 1.0]])[None]
    still = repeated(PlatformMotion(np.zeros((1, 3)), R, *np.zeros((4, 1, 3))), 2)
    careful: list[Any] = []
    whole = dynamics._careful
    monkeypatch.setattr(dynamics, "_careful", lambda *a: (careful.append(a), whole(*a))[1])
    if solved:
        assert np.isfinite(analytic.driving_forces(close, still, backend)).all()
    else:
        with pytest.raises(SingularPose, match=r"condition of the platform's equations = .*, above 1e\+12"):
            analytic.driving_forces(close, still, backend)
    assert careful
    careful.clear()
    analytic.driving_forces(P, trajectory.motion, backend)
    assert not careful


def test_the_regularity_bounds_the_condition(hexapod: Scene) -> None:
    """What `REGULAR` lets through is below `LIMIT`: random machines of all sizes, some nearly singular."""
    rng = np.random.default_rng(3)
    P = parameters(hexapod)
    conditions = []
    for _ in range(300):
        size, off = 10.0 ** rng.uniform(-4, 4), 10.0 ** rng.uniform(-5, 0)
        p = rng.normal(size=(6, 3)) * size
        O = 3.0 * p + off * size * rng.normal(size=(6, 3))
        Q = replace(P, p=tuple(map(tuple, p.tolist())), O=tuple(map(tuple, O.tolist())))
        still = PlatformMotion(np.zeros((1, 3)), np.eye(3)[None], *np.zeros((4, 1, 3)))
        one = one_sample(still, 0)
        _, regularity = DRIVING_FORCES.evaluate(Q, flat(one), math.sqrt, ordered_numbers)
        y = (p - O) / np.linalg.norm(p - O, axis=1, keepdims=True)
        A = np.vstack([y.T, np.cross(p, y).T / np.linalg.norm(p, axis=1).max()])
        assert np.linalg.cond(A) <= LIMIT * evaluate.REGULAR / regularity
        conditions.append(np.linalg.cond(A))
    assert min(conditions) < 30
    assert max(conditions) > 1e4


@pytest.mark.parametrize("backend", BACKENDS)
def test_collinear_legs_keep_their_meaning_in_every_back_end(backend: str, collinear: Scene) -> None:
    motion = from_scene(collinear, 5).motion
    D = analytic.inverse_dynamics(collinear.parameters, motion, backend)
    assert D.undetermined.all()
    np.testing.assert_allclose(D.F[:, 0] + D.F[:, 1], 0.0, atol=1e-13)
    lifted = motion.ddC_p + np.array([0.0, 1.0, 0.0])
    with pytest.raises(Infeasible, match=r"sample \d: the motion is infeasible"):
        analytic.driving_forces(collinear.parameters, motion._replace(ddC_p=lifted), backend)


@pytest.fixture
def collinear() -> Scene:
    return load_scene("collinear")


@pytest.mark.parametrize("backend", BACKENDS)
def test_five_legs_say_what_is_determined(backend: str, hexapod: Scene, trajectory: Trajectory) -> None:
    P = parameters(hexapod)
    five = replace(P, p=P.p[:5], O=P.O[:5])
    with pytest.raises(NotDeterminate) as e:
        analytic.driving_forces(five, trajectory.motion, backend)
    assert np.shape(e.value.determined.loads[4].M_in) == (21,)


def test_one_after_another_without_overhead(hexapod: Scene, trajectory: Trajectory) -> None:
    P, m = parameters(hexapod), trajectory.motion
    loop, every, F = ControlLoop(P), ControlLoop(P, "inverse_dynamics"), analytic.driving_forces(P, m)
    numbers = analytic.inverse_dynamics(P, m).numbers
    for k in range(len(F)):
        loop.given[:] = every.given[:] = np.concatenate([a[k].ravel() for a in m])
        loop()
        every()
        np.testing.assert_allclose(loop.found, F[k], rtol=0, atol=ROUNDING * 335)
        np.testing.assert_allclose(every.found, numbers[:, k], rtol=0, atol=ROUNDING * 335)
    loop.given[3:12] = 0.0
    with pytest.raises(SingularPose, match="parallel singularity"):
        loop()
    loop.given[3:12] = m.R[0].ravel()
    loop.given[20] = np.nan
    with pytest.raises(ValueError, match=r"motion.ddC_p: sample 0 is not finite"):
        loop()
    with pytest.raises(AttributeError):
        loop.given = np.zeros(24)  # type: ignore[misc]
    with pytest.raises(ValueError, match="problem: got 'forces', expected one of driving_forces, inverse_dynamics"):
        ControlLoop(P, "forces")


@pytest.mark.parametrize("name", ["hexapod", "planar3", "pointmass2"])
def test_accelerations_one_after_another(name: str) -> None:
    scene = load_scene(name)
    P, m = scene.parameters, from_scene(scene, 5).motion
    F = analytic.driving_forces(P, m)
    loop = ControlLoop(P, "forward_dynamics")
    wanted = np.hstack([m.ddC_p, m.dw_p])[:, evaluate.FORWARD_DYNAMICS.rows(P)]
    for k in range(5):
        loop.given[:] = np.concatenate([a[k].ravel() for a in (m.C_p, m.R, m.dC_p, m.w_p, F)])
        loop()
        np.testing.assert_allclose(loop.found, wanted[k], rtol=0, atol=2e-13 * np.abs(wanted).max())


def test_a_steep_leg_is_doubted_in_the_loop_too(hexapod: Scene, trajectory: Trajectory) -> None:
    """Leg 3 nearly upright, at rest: the loop's answer is that of the form with compliances; upright it is refused."""
    P, m = parameters(hexapod), trajectory.motion
    loop, F = ControlLoop(P, "forward_dynamics"), np.full((1, 6), 50.0)
    for lean in (1e-3, 0.0):
        C_p = np.array(P.O[2]) - m.R[1] @ P.p[2] + (lean, 1.0, 0.0)
        still = PlatformMotion(C_p[None], m.R[1:2], *np.zeros((4, 1, 3)))
        loop.given[:] = np.concatenate([C_p, m.R[1].ravel(), np.zeros(6), F[0]])
        if lean:
            loop()
            a = analytic.forward_dynamics(P, still, F, "compliance")
            np.testing.assert_array_equal(loop.found, np.hstack([a.ddC_p, a.dw_p])[0])
        else:
            with pytest.raises(SingularPose, match="leg 3: sin q_n"):
                loop()


def test_threads_do_not_disturb_each_other(hexapod: Scene, trajectory: Trajectory) -> None:
    P = hexapod.parameters
    motions = [repeated(PlatformMotion(*(a[k : k + 5] for a in trajectory.motion)), BLOCK) for k in (0, 10)]
    wanted = [analytic.driving_forces(P, m) for m in motions]
    wrong: list[int] = []

    def work(k: int) -> None:
        for _ in range(20):
            if not np.array_equal(analytic.driving_forces(P, motions[k]), wanted[k]):
                wrong.append(k)

    threads = [threading.Thread(target=work, args=(k,)) for k in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


@pytest.mark.parametrize("kind", KINDS)
def test_more_digits_are_more_digits(
    kind: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ctx, "prec", 200)
    P = parameters(hexapod)
    F = precise_driving_forces(P, trajectory.motion, kind)
    # the truth is given as float64, with radii of half a unit in the last place; its F is rounded, and so is ours here
    assert np.abs(np.vectorize(float)(F) - truth.F).max() <= np.spacing(335.0)
    coarse = analytic.driving_forces(P, trajectory.motion)
    balls = precise_driving_forces(P, trajectory.motion, "ball")
    beyond = (
        max(abs(float(arb(str(x)) - b)) for x, b in zip(np.ravel(F), np.ravel(balls), strict=True))
        if (kind == "long double")
        else 0.0
    )
    assert beyond < 1e-3 * np.abs(coarse - truth.F).max()  # eleven more bits, at least ten of which are seen


# --- What it costs, without a clock -----------------------------------------------------------------------------------


FLOPS = {
    ("hexapod", DRIVING_FORCES): 1466,
    ("hexapod", INVERSE_DYNAMICS): 2072,
    ("hexapod", FORWARD_DYNAMICS): 2581,
    ("tsai2000", DRIVING_FORCES): 1240,
    ("tsai2000", INVERSE_DYNAMICS): 1654,
    ("planar3", DRIVING_FORCES): 255,
    ("planar3", INVERSE_DYNAMICS): 378,
    ("pointmass2", DRIVING_FORCES): 121,
    ("pointmass2", INVERSE_DYNAMICS): 203,
}


@pytest.mark.parametrize(("name", "problem"), FLOPS, ids=lambda x: getattr(x, "name", x))
def test_operations_are_counted(name: str, problem: Problem) -> None:
    """More of them is a regression of speed, on any machine; fewer is a reason to change the number here."""
    counts = traced(load_scene(name).parameters, problem).counts()
    assert counts["flops"] == FLOPS[name, problem]
    if (name, problem) == ("hexapod", INVERSE_DYNAMICS):
        assert (counts["/"], counts["sqrt"], counts["select"]) == (24, 12, 170)


def test_what_a_machine_lacks_costs_nothing(hexapod: Scene) -> None:
    P = parameters(hexapod)
    flops = traced(P, INVERSE_DYNAMICS).counts()["flops"]
    without = replace(P, leg=replace(P.leg, m_o=0.0, J_oz=0.0, J_ny=0.0, J_sz=0.0))
    tilted = replace(P, g=(1.0, -9.0, 2.0), I_p=((1.3, 0.1, 0.2), (0.1, 2.4, 0.3), (0.2, 0.3, 1.5)))
    assert traced(without, INVERSE_DYNAMICS).counts()["flops"] < 0.85 * flops
    assert traced(tilted, INVERSE_DYNAMICS).counts()["flops"] > flops


@pytest.mark.parametrize(("every", "most"), [(False, 142), (True, 262)])
def test_registers_are_used_again(every: bool, most: int, hexapod: Scene) -> None:
    """Arrays of a block: 24 of the motion, every result that is asked for, and what is alive in between."""
    program = traced(parameters(hexapod), INVERSE_DYNAMICS if every else DRIVING_FORCES)
    count = registers.allocation(program)[1]
    assert count <= most
    assert count < len(program.operations) / 8


def test_blocks_need_no_memory_of_their_own(hexapod: Scene, trajectory: Trajectory) -> None:
    """From the second call on NumPy holds the block's motion, turned, and a mask: no array per operation."""
    P, motion = parameters(hexapod), repeated(trajectory.motion, 4 * BLOCK)
    D = InverseDynamics.zeros(4 * BLOCK, 6)
    analytic.inverse_dynamics(P, motion, "numpy", D)
    tracemalloc.start()
    try:
        analytic.inverse_dynamics(P, motion, "numpy", D)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 30 * 8 * BLOCK  # 24 columns and their booleans; results of a block alone would be 144
