"""Hard motions: their truth and its sensitivity, guards that see an integration fall apart, and the rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from stewart_crosscheck.crosscheck import certain_motion as module
from stewart_crosscheck.crosscheck import stress_time
from stewart_crosscheck.crosscheck.cases.in_time_ import CASES
from stewart_crosscheck.crosscheck.certain_motion import certain_motion
from stewart_crosscheck.crosscheck.credible import exchanged, require_credible
from stewart_crosscheck.crosscheck.engine import REFERENCE, EngineError, Failure, crashed, load_engine
from stewart_crosscheck.crosscheck.engines.analytic_ import AnalyticEngine
from stewart_crosscheck.crosscheck.engines.reference_ import NotCertified
from stewart_crosscheck.crosscheck.hard import Passage, TimeCase
from stewart_crosscheck.crosscheck.outcome import ACCURATE, DEGRADED, REFUSED, SILENT
from stewart_crosscheck.crosscheck.problem import Problem, pose
from stewart_crosscheck.crosscheck.simulation import QUADRATURE_ORDER, hardness, pose_errors
from stewart_crosscheck.crosscheck.stepping import Method, Simulated
from stewart_crosscheck.crosscheck.stress_time import QUANTITIES, time_rows
from stewart_crosscheck.crosscheck.tasks import simulated
from stewart_crosscheck.crosscheck.tolerance import NEAR, QUADRATURE
from stewart_crosscheck.crosscheck.true_motion import forces_defect, responses, true_motion
from stewart_crosscheck.models import Scene, load_scene, write_models

BY_NAME = {case.name: case for case in CASES}


def posed(name: str, value: float, intervals: int | None = None) -> tuple[Passage, Problem]:
    """A value of a case and its problem."""
    passage = BY_NAME[name].at(value)
    return passage, pose(passage.scene, passage.duration, (intervals or passage.intervals) + 1)


def lines(scene: Scene, position: np.ndarray, quaternion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vectors from hull pins to tips (nt, N, 3), and determinants (nt,) of the forces along them: own geometry."""
    from scipy.spatial.transform import Rotation

    R = Rotation.from_quat(quaternion[:, [1, 2, 3, 0]]).as_matrix()
    r = np.einsum("tij,nj->tni", R, np.array(scene.pins))
    leg = position[:, None] + r - np.array(scene.hull.pins)
    axis = leg / np.linalg.norm(leg, axis=2, keepdims=True)
    return leg, np.linalg.det(np.concatenate([axis, np.cross(r, axis)], axis=2))


# The truth.


@pytest.fixture(scope="module")
def short() -> Problem:
    return pose(load_scene("hexapod"), 0.05, 6)


def away(problem: Problem, scene: Scene, **how: Any) -> tuple[np.ndarray, float]:
    """Errors against the problem's own motion, and the defect."""
    motion, found = problem.motion(), certain_motion(scene, problem.start, problem.forces, problem.t, **how)
    errors = pose_errors(cast(Any, found), motion.position, motion.unit_quaternion)
    return errors.max(axis=0), found.defect


def test_a_certain_motion_is_the_motion_whose_forces_were_given(short: Problem) -> None:
    errors, defect = away(short, short.scene)
    assert errors.max() < 1e-15
    assert defect < 1e-12


def test_a_wrong_mass_leads_away(short: Problem) -> None:
    platform = short.scene.platform.model_copy(update={"mass": short.scene.platform.mass * (1.0 + 1e-9)})
    errors, defect = away(short, short.scene.model_copy(update={"platform": platform}))
    assert errors.max() > 1e-14
    assert defect < 1e-12  # it is the certain motion of another machine


def test_the_defect_shows_too_few_nodes(short: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """It bounds what a coarse motion is off by."""
    monkeypatch.setattr(module, "TAIL", 1e-3)
    errors, defect = away(short, short.scene, n=5)
    assert defect > 1e-10
    assert 1e-14 < errors.max() < defect * short.duration


def test_other_nodes_lead_to_the_same_motion() -> None:
    """Past the vertical at a tenth of a millimetre."""
    passage, problem = posed("passing_vertical", 1e-4)
    t = np.linspace(0.0, 0.02, 201)
    a, b = (certain_motion(passage.scene, problem.start, problem.forces, t, n=n) for n in (16, 13))
    assert np.abs(np.hstack(a[:4]) - np.hstack(b[:4])).max() < 1e-15
    leg = lines(passage.scene, a.position, a.quaternion)[0][:, 0]
    aside = np.interp(0.0, -leg[:, 0], leg[:, 2])
    assert aside == pytest.approx(1e-4, rel=0.01)
    assert leg[0, 0] < 0.0 < leg[-1, 0]


def test_what_is_too_fast_is_given_up(short: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "TAIL", 0.0)
    monkeypatch.setattr(module, "ROUGH", 0.0)
    monkeypatch.setattr(module, "SHORTEST", 0.01)
    with pytest.raises(NotCertified, match="t = 0 s: the motion is too fast"):
        away(short, short.scene)


@pytest.mark.parametrize("speed", [10.0, 0.3])
def test_the_turning_platform_passes_a_singular_pose(speed: float) -> None:
    passage, problem = posed("turning_through_singular", speed)
    found = certain_motion(passage.scene, problem.start, problem.forces, problem.t)
    determinant = lines(passage.scene, found.position, found.quaternion)[1]
    assert determinant[0] > 0.0 > determinant[-1]


@pytest.mark.parametrize("distance", [1e-1, 1e-4])
def test_the_circling_leg_is_as_near_the_vertical_as_it_says(distance: float) -> None:
    passage, problem = posed("circling_vertical", distance)
    start = problem.start
    leg = lines(passage.scene, start.position, start.unit_quaternion)[0][0, 0]
    assert np.hypot(leg[0], leg[2]) == pytest.approx(distance, rel=1e-9)


def test_the_sensitivity_is_that_of_moved_inputs() -> None:
    """Against the formulas' own solutions from moved starts and under moved forces, changes added up."""
    passage, problem = posed("turning_through_singular", 3.0, intervals=5)
    engine, start = AnalyticEngine(passage.scene), problem.start
    solution = engine.methods(problem)[0]
    base, by = engine.simulate(problem, solution), 1e-6
    half = 2.0**-54
    moved = []
    for name in ("position", "velocity", "angular_velocity"):
        for k, x in enumerate(getattr(start, name)[0]):
            other = replace(problem, start=replace(start, **{name: getattr(start, name) + by * np.eye(3)[k]}))
            moved.append((other, 0.5 * np.spacing(abs(x))))
    for turn in np.eye(3):
        w, v = start.quaternion[0, 0], start.quaternion[0, 1:]
        q = start.quaternion + 0.5 * by * np.concatenate([[-turn @ v], w * turn + np.cross(turn, v)])
        moved.append((replace(problem, start=replace(start, quaternion=q)), 4.0 * half))
    for k in range(6):
        legs = list(problem.scene.forces.legs) if problem.scene.forces else []
        legs[k] = legs[k].model_copy(update={"c0": legs[k].c0 * (1.0 + by)})
        forces = cast(Any, problem.scene.forces).model_copy(update={"legs": tuple(legs)})
        other = replace(problem, scene=problem.scene.model_copy(update={"forces": forces}))
        moved.append((other, 2.0 * half))
    total = sum(np.abs(engine.simulate(p, solution).position - base.position) * h / by for p, h in moved)
    want = float(np.linalg.norm(np.asarray(total), axis=1).max())
    assert true_motion(problem).pose == pytest.approx(
        want, rel=0.2
    )  # what is uncertain of the truth itself comes on top


def test_the_growth_is_that_of_a_falling_pendulum() -> None:
    """x'' = 4 x: a small error grows as cosh 2t, a force of 3 per unit as 3 (cosh 2t - 1) / 4."""
    A = np.zeros((50, 12, 12))
    A[:, range(6), range(6, 12)] = 1.0
    A[:, range(6, 12), range(6)] = 4.0
    B = np.zeros((50, 12, 1))
    B[:, 6] = 3.0
    grown = responses(A, B, 0.02)[-1]
    assert grown[0, 0] == pytest.approx(np.cosh(2.0), rel=1e-12)
    assert grown[0, 12] == pytest.approx(0.75 * (np.cosh(2.0) - 1.0), rel=1e-12)


def test_forces_of_a_motion_are_held_against_certified_ones(hexapod: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = pose(hexapod, 0.05, 6)
    assert forces_defect(problem) < 1e-14
    forces = Problem.forces
    monkeypatch.setattr(Problem, "forces", lambda self, t: forces(self, t) * (1.0 + 1e-9))
    with pytest.raises(EngineError, match="the driving forces of the motion are off by 1"):
        true_motion(problem)


# Guards.


def settled(problem: Problem, gap: float = 0.0, energy: float = 0.0) -> Simulated:
    """The problem's motion, with a gap [m] and an energy [J] that comes from nowhere half-way."""
    motion, n = problem.motion(), len(problem.grid)
    kinetic = np.linspace(0.0, 40.0, n)
    nowhere = np.where(np.arange(n) > n // 2, energy, 0.0)
    q = motion.unit_quaternion
    return Simulated(
        motion.position, q, motion.velocity, motion.angular_velocity, kinetic + nowhere, np.zeros(n),
        kinetic, gap, 0.0,
    )  # fmt: skip


def test_open_loops_and_made_energy_are_refused(short: Problem) -> None:
    require_credible("x", short, settled(short, gap=0.9 * NEAR * short.length, energy=3.9))
    assert exchanged(short, settled(short)) == 40.0
    with pytest.raises(EngineError, match=r"x: a loop came open by 0.2 m, expected at most 0.1 of the longest leg"):
        require_credible("x", short, settled(short, gap=0.2))
    with pytest.raises(EngineError, match=r"x: t = 0.04 s: the energy is off by 20 J, expected at most 0.1 of the"):
        require_credible("x", short, settled(short, energy=20.0))


def run(name: str, case: str, value: float, route: str, integrator: str = "") -> Simulated:
    """What an engine's process answers to a value of a case, with the step of its passage."""
    passage = BY_NAME[case].at(value)
    longest = max(1e-2, passage.step)
    problem = pose(passage.scene, passage.duration, passage.intervals + 1, longest)
    engine = cast(Any, load_engine(name))
    method = next(m for m in engine.methods(problem) if m.route == route and integrator in m.integrator)
    method = method._replace(steps=round(problem.spacing / passage.step))
    settings = passage.settings.get((name, method.integrator))
    return simulated(name, write_models(passage.scene), problem, method, settings)


def test_a_gain_that_is_too_stiff_opens_the_loops() -> None:
    assert run("analytic", "stiff_gains", 2.5, "dae", "Baumgarte").gap < 1e-3  # explicit: unstable from 2.79
    with pytest.raises(EngineError, match=r"analytic: t = .* s: the loop of leg . came open by"):
        run("analytic", "stiff_gains", 3.0, "dae", "Baumgarte")


def test_steps_that_are_too_large_are_refused(engine_name: str) -> None:
    with pytest.raises(EngineError, match=f"{engine_name}: t = .* s: n. turns by 1.* rad in a step of 0.5 s"):
        run(engine_name, "large_steps", 0.5, "kkt")


def test_engines_that_fall_apart_are_refused(engine_name: str) -> None:
    """Their own steps: DART opens its loops without a word, MuJoCo warns, Pinocchio's are ours."""
    words = {"dart": "a loop came open", "mujoco": "warnings", "pinocchio": "turns by"}
    with pytest.raises(EngineError, match=words[engine_name]):
        run(engine_name, "large_steps", 0.5, "native")


@pytest.mark.parametrize("integrator", ["RK4", "RK4 + Baumgarte", "RK4 + projection"])
def test_a_base_that_turns_half_around_in_a_step_is_refused(integrator: str) -> None:
    with pytest.raises(EngineError, match=r"analytic: t = 0.01 s: q_o1 turns by 1.9. rad in a step of 0.001 s"):
        run("analytic", "passing_vertical", 1e-4, "dae", integrator)


@pytest.mark.parametrize("engine_name", ["dart"], indirect=True)
def test_energy_made_by_dart_past_the_vertical_is_refused(engine_name: str) -> None:
    with pytest.raises(EngineError, match=r"dart: t = .* s: the energy is off by"):
        run(engine_name, "passing_vertical", 1e-3, "native")


def test_the_quadrature_of_the_work_falls_as_it_is_said_to() -> None:
    """Coarse grids, which long steps need, are less accurate by the order of the spline, and not more than that."""
    scene = load_scene("hanging")
    problem = pose(scene, 2.0, 5, 0.1)
    fine = pose(scene, 2.0, 5)

    def work(p: Problem) -> np.ndarray:
        motion = p.motion() if p.parts == 1 else replace(p, t=p.grid).motion()
        power = np.sum(p.forces(p.grid) * AnalyticEngine(scene).inverse_dynamics(motion).dL, axis=1)
        return make_interp_spline(p.grid, power, k=5).antiderivative()(np.linspace(0.0, 2.0, 21))

    turnover = float(np.ptp(work(fine)))
    share = np.abs(work(problem) - work(fine)).max() / turnover
    assert QUADRATURE.value < share < QUADRATURE.value * 10.0**QUADRATURE_ORDER


def test_a_leg_that_starts_steep_has_more_rounding() -> None:
    near, far = (hardness(posed("circling_vertical", d)[1]) for d in (1e-4, 1e-1))
    assert 50.0 < near / far < 200.0
    assert hardness(posed("passing_vertical", 1e-4)[1]) == pytest.approx(far, rel=0.1)  # no inertia, no load


# Outcomes and rows.

STEPS = Method("kkt", "", "RK4", 2, 4)
OTHER = STEPS._replace(steps=1)


def outcomes(problem: Problem, true: Any, own: Simulated, other: Simulated | Failure) -> dict[str, str]:
    """By quantity, of the finer one of two runs."""
    passage = Passage(problem.scene, problem.duration, len(problem.t) - 1, 5e-3, 1e-2)
    p = stress_time._Posed(TimeCase("x", "", "", (1.0,), lambda value: passage), 1.0, passage, problem)
    results: Mapping[Any, Any] = {("x", STEPS): own, ("x", OTHER): other}
    rows = list(stress_time._rows(p, "x", STEPS, results, true))
    assert all(bool(row["reason"]) == (row["outcome"] != ACCURATE) for row in rows)
    return {row["quantity"]: row["outcome"] for row in rows}


def off(problem: Problem, by: float, gap: float) -> Simulated:
    """The motion, away by so many metres, with a gap [m]."""
    right = settled(problem, gap=gap)
    return replace(right, position=right.position + np.array([0.0, 0.0, by]))


def test_outcomes_tell_rounding_law_and_silence_apart(hexapod: Scene) -> None:
    problem = pose(hexapod, 0.1, 11)
    every, true = dict.fromkeys(QUANTITIES, ACCURATE), true_motion(problem)
    exact = off(problem, 0.0, 1e-16)
    assert outcomes(problem, true, exact, exact) == every
    coarse = off(problem, 16e-6, 16e-7)
    assert outcomes(problem, true, off(problem, 1e-6, 1e-7), coarse) == every | {"pose": DEGRADED, "gap": DEGRADED}
    stuck = off(problem, 1e-6, 1e-7)  # half the step has not helped
    assert outcomes(problem, true, stuck, stuck) == every | {"pose": SILENT, "gap": SILENT}
    assert outcomes(problem, true, stuck, Failure("late")) == every | {"pose": DEGRADED, "gap": DEGRADED}
    made = replace(exact, kinetic=exact.kinetic + 1e-3 * np.linspace(0.0, 1.0, len(exact.kinetic)))
    assert outcomes(problem, true, made, made) == every | {"energy": SILENT}


def test_without_truth_an_answer_is_silent_and_a_refusal_is_one(hexapod: Scene) -> None:
    problem = pose(hexapod, 0.1, 11)
    passage = Passage(hexapod, 0.1, 10, 1e-2, 5e-3)
    p = stress_time._Posed(TimeCase("x", "", "", (1.0,), lambda value: passage), 1.0, passage, problem)
    for answer, outcome in ((settled(problem), SILENT), (Failure("late"), REFUSED)):
        rows = list(stress_time._rows(p, "x", STEPS, {("x", STEPS): answer}, Failure("too fast")))
        assert [row["quantity"] for row in rows] == list(QUANTITIES)
        assert {row["outcome"] for row in rows} == {outcome}


def test_what_would_take_minutes_is_left_out() -> None:
    p = stress_time._Posed.of(BY_NAME["long_motion"], 1e4)
    asked = {name: {own.route for own, _ in p.pairs(name, load_engine(name))} for name in ("analytic", "mujoco")}
    assert asked == {"analytic": {"closed_form"}, "mujoco": {"native"}}
    p = stress_time._Posed.of(BY_NAME["long_motion"], 1e2)
    pairs = list(p.pairs("analytic", load_engine("analytic")))
    assert [own.route for own, _ in pairs] == ["closed_form", "dae", "dae", "dae"]
    assert {(own.dt(p.problem), other.dt(p.problem)) for own, other in pairs[1:]} == {(1e-4, 2e-4)}
    assert not list(p.pairs(REFERENCE, load_engine(REFERENCE)))


def hang(value: float) -> Passage:
    wrong = {("mujoco", "mj_step RK4"): {"impedance": "hard"}} if value == 3.0 else {}
    return Passage(load_scene("hanging"), 0.05, 5, 5e-3, 1e-2, cast(Any, wrong))


SMALL = TimeCase("small", "a small one", "number", (1.0, 2.0, 3.0), hang)


@pytest.mark.parametrize("engine_name", ["mujoco"], indirect=True)
def test_rows_of_every_method_and_a_broken_setting_is_refused(engine_name: str) -> None:
    engines = {name: load_engine(name) for name in ("analytic", engine_name, REFERENCE)}
    lines: list[tuple[str, int]] = []
    rows = time_rows([SMALL], engines, 2, done=lambda line, total: lines.append((line, total)))
    keys = {(r["value"], r["engine"], r["route"], r["quantity"]) for r in rows}
    assert len(keys) == len(rows) == 3 + 5 * 4 + 4  # value 1: closed form, dae, kkt, native; 3: the one with settings
    assert {"dae", "dae + Baumgarte", "dae + projection"} < {r["route"] for r in rows}
    assert len({total for _, total in lines}) == 1
    assert len(lines) == lines[0][1]
    by_value = {value: {r["outcome"] for r in rows if r["value"] == value} for value in (1.0, 3.0)}
    assert by_value == {1.0: {ACCURATE, DEGRADED}, 3.0: {REFUSED}}
    assert all(r["max_rel_error"] < 1e-12 for r in rows if r["route"] == "closed_form")
    assert all(r["condition"] >= 1.0 for r in rows)
    assert all("could not convert" in r["reason"] for r in rows if r["value"] == 3.0)


ONE = TimeCase("one", "", "", (1.0,), lambda value: hang(value)._replace(settings={("analytic", "DOP853"): {}}))


def test_without_the_reference_no_answer_is_judged() -> None:
    rows = time_rows([ONE], {"analytic": load_engine("analytic")})
    assert {(r["outcome"], r["reason"].split(": ")[-1]) for r in rows} == {(REFUSED, "it did not run")}


def test_late_answers_are_refusals(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stress_time, "LIMIT", 0.01)
    rows = time_rows([ONE], {n: load_engine(n) for n in ("analytic", REFERENCE)})
    assert {(r["outcome"], r["reason"].split(": ")[-1]) for r in rows} == {(REFUSED, "no answer within 0 s")}
    late: list[tuple[str, Failure]] = []
    time_rows([ONE], {n: load_engine(n) for n in ("analytic", REFERENCE)}, failed=late)
    assert {name for name, _ in late} == {"analytic", REFERENCE}
    assert all(failure.reason == "one: no answer within 0 s" for _, failure in late)
    assert crashed(late) == []
