"""Simulations side by side: orders of convergence, energy, growth, stages, failures, files and messages."""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from stewart_crosscheck.analytic import PlatformMotion, State, growth_rates
from stewart_crosscheck.analytic import simulate as simulate_analytic
from stewart_crosscheck.analytic.stability import linearised
from stewart_crosscheck.crosscheck import simulate as simulate_module
from stewart_crosscheck.crosscheck import simulation, stepping, tasks
from stewart_crosscheck.crosscheck.credible import exchanged
from stewart_crosscheck.crosscheck.engine import Failure, load_engine
from stewart_crosscheck.crosscheck.problem import Problem, Staged, pose
from stewart_crosscheck.crosscheck.simulate import SimulationReport, simulate
from stewart_crosscheck.crosscheck.simulation import Solution, pose_errors
from stewart_crosscheck.crosscheck.stepping import Method, Simulated, SteppingEngine, continuous
from stewart_crosscheck.crosscheck.tasks import simulates
from stewart_crosscheck.crosscheck.trajectory import TrajectoryError, along
from stewart_crosscheck.models import Scene, load_scene, scene_names, write_models
from stewart_crosscheck.reports import SIMULATION_COLUMNS

STATES_COLUMNS = "engine route integrator dt t p_x p_y p_z q_w q_x q_y q_z v_x v_y v_z w_x w_y w_z".split()


def stepping_engine(name: str, scene: Scene) -> SteppingEngine:
    engine = load_engine(name)(scene)
    assert isinstance(engine, SteppingEngine)
    return engine


def errors(problem: Problem, s: Simulated) -> np.ndarray:
    """Largest error of the pose, m and rad."""
    motion = problem.motion()
    return pose_errors(s, motion.position, motion.unit_quaternion).max(axis=0)


def with_tables(scene: Scene, **tables: Any) -> Scene:
    data = scene.model_dump(exclude_none=True, by_alias=True) | tables
    return Scene.model_validate({key: value for key, value in data.items() if value is not None})


def thrown(scene: Scene) -> Scene:
    """The scene without motion: constant forces, and a start of its own."""
    start = along(scene, np.zeros(1))
    initial: dict[str, Any] = {"position": start.position[0].tolist(), "velocity": [0.1, -0.2, 0.0]}
    if scene.freedom != "point":
        initial |= {"orientation": {"kind": "rotation_vector", "angles": [0.0, 0.0, 0.1]}}
        initial |= {"angular_velocity": [0.0, 0.0, 0.3]}
    F = load_engine("analytic")(scene).inverse_dynamics(start).F[0]
    forces = {"legs": [{"c0": 1.05 * f, "terms": [[3.0, 4.0, 0.2]]} for f in F]}
    return with_tables(scene, motion=None, initial=initial, forces=forces)


# --- Orders -----------------------------------------------------------------------------------------------------------


def half_second(scene: Scene) -> Problem:
    return pose(scene, 0.5, 11)


@pytest.mark.parametrize("scene", ["hexapod", "planar3"])
def test_hard_loops_are_of_order_4(scene: str, engine_name: str) -> None:
    """Pose, gap and energy: what the integrator leaves falls by 16 as the step is halved."""
    problem = half_second(load_scene(scene))
    engine = stepping_engine(engine_name, problem.scene)
    coarse, fine = (engine.simulate(problem, m) for m in engine.methods(problem) if m.route == "kkt")
    position, turn = np.log2(errors(problem, coarse) / errors(problem, fine))
    assert position == pytest.approx(4.0, abs=0.2)  # the next term of the error: 3.95 to 4.01
    assert turn == pytest.approx(4.0, abs=0.2)
    assert math.log2(coarse.gap / fine.gap) == pytest.approx(4.0, abs=0.2)
    assert math.log2(np.abs(coarse.defect).max() / np.abs(fine.defect).max()) == pytest.approx(4.0, abs=0.4)


ORDERS = {"mujoco": 2.0, "pinocchio": 4.0, "dart": 1.0}


@pytest.mark.parametrize("scene", ["hexapod", "pointmass2"])
def test_own_steps_are_of_their_order(scene: str, engine_name: str) -> None:
    """Softness of two steps in MuJoCo, the method of Runge and Kutta for Pinocchio, one of Euler's in DART."""
    problem = half_second(load_scene(scene))
    engine = stepping_engine(engine_name, problem.scene)
    methods = [m for m in engine.methods(problem) if m.route == "native"]
    coarse, fine = (errors(problem, engine.simulate(problem, m)) for m in methods)
    assert [m.order for m in methods] == [ORDERS[engine_name]] * 2
    assert math.log2(coarse[0] / fine[0]) == pytest.approx(ORDERS[engine_name], abs=0.1)


class Held(Staged):
    """Forces of the beginning of a step all through it."""

    def __call__(self, t: float) -> np.ndarray:
        return self.values[2 * int(2.0 * t / self.dt * 0.5 + 1e-6)]


def test_forces_that_do_not_follow_the_stages_lose_orders(
    engine_name: str, hexapod: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On every route with stages: the steps of DART have none, and are of first order as they are."""
    problem = half_second(hexapod)
    engine = stepping_engine(engine_name, hexapod)
    for route in ("kkt", "native") if ORDERS[engine_name] > 1.0 else ("kkt",):
        methods = [m for m in engine.methods(problem) if m.route == route]
        good = errors(problem, engine.simulate(problem, methods[1]))[0]
        with monkeypatch.context() as held:
            held.setattr(stepping, "Staged", Held)
            coarse, fine = (errors(problem, engine.simulate(problem, m))[0] for m in methods)
        assert math.log2(coarse / fine) == pytest.approx(1.0, abs=0.1)
        assert fine > 1e3 * good


def test_stages_are_ends_and_middles_of_steps(hexapod: Scene) -> None:
    problem = pose(hexapod, 0.1, 4)
    F = Staged(problem, 3)
    assert problem.parts == 4  # 0.1 / 3 s in parts of 10 ms at most
    for t in (0.0, 0.5 * F.dt, 0.1 - F.dt, 0.1):
        np.testing.assert_allclose(F(t), problem.forces(np.array([t]))[0], rtol=1e-12)  # rounding of t
    with pytest.raises(ValueError, match=r"is no stage of steps"):
        F(0.3 * F.dt)


# --- Energy, start, continuity ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("point", [False, True])
def test_energy_is_the_work_of_forces_and_load(point: bool, engine_name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a load: 1e-8 of the energy is what steps of 5 ms leave; an error of a percent in the work is seen."""
    load: dict[str, Any] = {"force": [11.0, -7.0, 0.0]}
    if not point:
        load |= {"moment": [0.0, 0.0, 3.0], "point": [0.1, 0.2, 0.0]}
    scene = with_tables(load_scene("pointmass2" if point else "planar3"), load=load)
    problem = half_second(scene)
    engine = stepping_engine(engine_name, scene)
    method = engine.methods(problem)[1]
    s = engine.simulate(problem, method)
    assert np.abs(s.defect).max() < 1e-8 * exchanged(problem, s)
    moved = engine.runge_kutta(problem, Staged(problem, 2), 2, engine.accelerate)
    monkeypatch.setattr(engine, "runge_kutta", lambda *a: moved)
    monkeypatch.setattr(engine, "scene", with_tables(scene, load=load | {"force": [11.0, -7.1, 0.0]}))
    wrong = engine.simulate(problem, method)  # the same motion, its load counted wrong
    assert np.abs(wrong.defect).max() > 1e-5 * exchanged(problem, wrong)


@pytest.mark.parametrize("route", ["kkt", "native"])
def test_every_engine_starts_where_the_problem_does(route: str, engine_name: str, hexapod: Scene) -> None:
    """What an engine's own model says of the start is the start: rounding."""
    problem = pose(hexapod, 0.01, 2)
    engine = stepping_engine(engine_name, hexapod)
    s = engine.simulate(problem, next(m for m in engine.methods(problem) if m.route == route))
    start = problem.start
    for got, want in (
        (s.position, start.position),
        (s.quaternion, start.unit_quaternion),
        (s.velocity, start.velocity),
        (s.angular_velocity, start.angular_velocity),
    ):
        np.testing.assert_allclose(got[0], want[0], rtol=0, atol=2e-15)


def test_quaternions_begin_positive_and_go_on_without_jumps() -> None:
    angle = np.linspace(0.0, 4 * np.pi, 41)  # two turns: q_w goes through zero and -1
    R = np.moveaxis(
        np.array(
            [
                [np.cos(angle), -np.sin(angle), 0 * angle],
                [np.sin(angle), np.cos(angle), 0 * angle],
                [0 * angle, 0 * angle, 1 + 0 * angle],
            ]
        ),
        -1,
        0,
    )
    q = continuous(R)
    assert q[0, 0] > 0
    assert np.abs(np.diff(q, axis=0)).max() < 0.2
    assert q[:, 0].min() < -0.9
    assert continuous(R[10:])[0, 0] >= 0


# --- Growth -----------------------------------------------------------------------------------------------------------


def test_a_small_error_grows_as_the_linearised_motion_says(hexapod: Scene) -> None:
    """Two simulations side by side against d' = A(t) d, from the same deviation of 1e-6."""
    problem = pose(hexapod, 0.4, 41)
    motion, t = problem.motion(), problem.t
    F = problem.forces(t)
    A = linearised(hexapod.parameters, motion.motion, F)
    d = np.zeros(12)
    d[[0, 7]] = 1.0
    h = 2 * (t[1] - t[0])
    for k in range(0, 40, 2):  # steps over two samples, whose middle is one
        k1 = A[k] @ d
        k2 = A[k + 1] @ (d + 0.5 * h * k1)
        k3 = A[k + 1] @ (d + 0.5 * h * k2)
        d = d + h / 6 * (k1 + 2 * k2 + 2 * k3 + A[k + 2] @ (d + h * k3))

    def end(by: float) -> np.ndarray:
        m = along(hexapod, np.zeros(1))
        start = State(m.position[0] + [by, 0, 0], m.quaternion[0], m.velocity[0] + [0, by, 0], m.angular_velocity[0])
        forces = Staged(problem, 1)
        s = simulate_analytic(hexapod.parameters, start, forces, np.array([0.0, 0.4]), problem.spacing)
        return np.concatenate([s.position[-1], s.velocity[-1], s.angular_velocity[-1]])

    got = (end(1e-6) - end(-1e-6)) / 2e-6
    np.testing.assert_allclose(got, d[[0, 1, 2, 6, 7, 8, 9, 10, 11]], rtol=0, atol=1e-5 * np.abs(d).max())


def rates(scene: Scene) -> np.ndarray:
    """Real parts of the eigenvalues (nt, n)."""
    problem = pose(scene, None, 21)
    A = linearised(scene.parameters, problem.motion().motion, problem.forces(problem.t))
    return np.linalg.eigvals(A).real


def test_a_hanging_platform_is_stable_and_a_standing_one_is_not() -> None:
    assert np.abs(rates(load_scene("hanging"))).max() < 0.05  # 1/s; it moves, or they were zero
    standing = rates(load_scene("hexapod"))
    assert (np.sort(standing[0])[6:] > 1.5).all()  # all six at the start, 1.6 to 5.9
    assert 5.0 < standing.max(axis=1).min() < standing.max() < 10.0


def test_growth_of_a_point_mass_on_two_pushing_legs() -> None:
    """A point mass on two equal legs at +-45 deg that push with F each: by symmetry x'' = k x, from the geometry."""
    scene = load_scene("pointmass2")
    m, leg = scene.platform.mass, scene.leg
    light = with_tables(
        scene,
        gravity=(0.0, 0.0, 0.0),
        motion=None,
        hull={"pins": [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]},
        leg={"a": leg.a, "guide": {"mass": 1e-9, "com": 0.0, "J_x": 1e-9}, "rod": {"mass": 1e-9, "J_x": 1e-9}},
    )
    one, zero = np.array([[0.0, 1.0, 0.0]]), np.zeros((1, 3))
    motion = PlatformMotion(one, np.eye(3)[None], zero, zero, zero, zero)
    F, L = 50.0, math.sqrt(2.0)
    # Each leg pushes along its unit vector u: d(F u)/dx = F (1 - u u^T) / L, twice F/(2 L) along x and along y.
    got = growth_rates(light.parameters, motion, np.array([[F, F]]))
    assert got[0] == pytest.approx(math.sqrt(F / (L * m)), rel=1e-6)


def test_amplification_is_the_integral_of_the_growth() -> None:
    t = np.linspace(0, 2, 101)
    s = Solution("motion", np.zeros((101, 3)), np.zeros((101, 4)), np.where(t < 1.0, -5.0, 3.0))
    assert s.amplification(t)[-1] == pytest.approx(math.exp(3.0), rel=0.05)  # what shrinks grows back: not counted
    assert s.amplification(t, since=1.5)[-1] == pytest.approx(math.exp(1.5), rel=1e-9)
    assert s.amplification(t, since=1.5)[:75] == pytest.approx(1.0)


# --- Side by side -----------------------------------------------------------------------------------------------------


def verdicts(report: SimulationReport) -> dict[tuple[str, str], set[str]]:
    table = report.simulation
    return {
        (e, r): set(table.loc[(table["engine"] == e) & (table["route"] == r), "verdict"])
        for e, r in zip(table["engine"], table["route"], strict=True)
    }


@pytest.fixture(scope="module")
def short() -> dict[str, SimulationReport]:
    """Every scene and engine, a quarter of a second."""
    return {name: simulate(pose(load_scene(name), 0.25, 6)) for name in scene_names()}


@pytest.mark.parametrize("name", scene_names())
def test_every_engine_agrees_in_every_scene(name: str, short: dict[str, SimulationReport]) -> None:
    report = short[name]
    table = report.simulation
    assert report.status == 0, table[table["verdict"] != "pass"][["engine", "route", "reason"]].to_string()
    spatial = report.problem.scene.topology == "spatial"
    found = verdicts(report)
    assert found.pop(("analytic", "dae")) == {"pass" if spatial else "unsupported"}
    assert found == {
        ("analytic", "closed_form"): {"pass"},
        **{(engine, route): {"pass"} for engine in ("dart", "mujoco", "pinocchio") for route in ("kkt", "native")},
    }
    assert set(table["against"]) - {""} == {"motion"}
    exact = table[table["route"].isin(["closed_form", "kkt"])]
    assert exact["a_error"].max() < 1e-13  # measured 5e-15; the bar is 1e-12
    assert exact["alpha_error"].max() < 1e-13
    solution = table[table["route"] == "closed_form"].iloc[0]
    assert max(solution["pose_error"], solution["rotation_error"]) < 1e-11
    assert solution["energy_defect"] < 1e-11


@pytest.mark.parametrize("name", scene_names())
def test_states_are_continuous_from_the_same_start(name: str, short: dict[str, SimulationReport]) -> None:
    states = short[name].states()
    assert list(states.columns) == STATES_COLUMNS
    runs = states.groupby(["engine", "route", "integrator", "dt"], dropna=False, sort=False)
    assert len(runs) == sum(isinstance(r, Simulated) for r in short[name].results.values())
    first = states.iloc[0]
    for _, run in runs:
        q = run[["q_w", "q_x", "q_y", "q_z"]].to_numpy()
        np.testing.assert_allclose(run["t"], short[name].problem.t)
        assert q[0, 0] >= 0
        assert (np.sum(q[1:] * q[:-1], axis=1) > 0.9).all()
        np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, rtol=0, atol=1e-15)
        np.testing.assert_allclose(
            run.iloc[0][STATES_COLUMNS[5:]].astype(float), first[STATES_COLUMNS[5:]].astype(float), rtol=0, atol=1e-14
        )


@pytest.mark.parametrize("name", ["hexapod", "pointmass2"])
def test_given_forces_and_a_start_are_held_against_the_analytic_solution(name: str) -> None:
    report = simulate(pose(thrown(load_scene(name)), 0.2, 5), ["mujoco", "analytic"])
    assert report.status == 0, report.simulation["reason"].tolist()
    table = report.simulation
    assert set(table.loc[table["engine"] == "mujoco", "against"]) == {"analytic"}
    own = table[table["route"] == "closed_form"].iloc[0]
    assert own["against"] == ""
    assert math.isnan(own["pose_error"])
    assert own["energy_defect"] < 1e-11
    assert table["a_error"].isna().all()  # no motion: no certified forces
    assert report.info["growth"]["max_rate"] > 0.0


def test_motion_forces_from_another_start_are_held_against_the_analytic_solution(hexapod: Scene) -> None:
    initial = thrown(hexapod).initial
    assert initial is not None
    scene = with_tables(hexapod, initial=initial.model_dump(exclude_none=True))
    report = simulate(pose(scene, 0.1, 3), ["pinocchio"])
    assert report.status == 0, report.simulation["reason"].tolist()
    assert report.info["against"] == "analytic"
    assert report.simulation["a_error"].notna().sum() == 9  # certified along the motion all the same


def test_other_numbers_of_legs_move_too(hexapod: Scene) -> None:
    """Forward dynamics needs no balance of legs and equations."""
    scene = thrown(hexapod)
    data = scene.model_dump(exclude_none=True, by_alias=True)
    for part in ("platform", "hull"):
        data[part]["pins"] = data[part]["pins"][:5]
    data["forces"]["legs"] = data["forces"]["legs"][:5]
    report = simulate(pose(Scene.model_validate(data), 0.05, 2), ["mujoco", "pinocchio", "dart"])
    assert report.status == 0, report.simulation["reason"].tolist()


# --- What is wrong shows ----------------------------------------------------------------------------------------------


def test_a_wrong_mass_fails(hexapod: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """A platform off by 4e-6 of its mass, in the URDF alone: motion and accelerations say so."""
    monkeypatch.setattr(
        simulate_module,
        "write_models",
        lambda scene: {n: t.replace('value="27.3"', 'value="27.3001"') for n, t in write_models(scene).items()},
    )
    report = simulate(pose(hexapod, 0.5, 11), ["pinocchio", "mujoco"])
    assert report.status == 1
    found = verdicts(report)
    assert found["pinocchio", "kkt"] == found["pinocchio", "native"] == {"fail"}
    assert found["mujoco", "kkt"] == found["analytic", "closed_form"] == {"pass"}
    reason = report.simulation[report.simulation["engine"] == "pinocchio"]["reason"].iloc[0]
    assert "pose " in reason
    assert "law_of_order_4" in reason
    assert "accelerations " in reason


def fake(problem: Problem, by: float, tilt: float = 0.0, energy: float = 0.0) -> Simulated:
    """The prescribed motion, off by a distance, an angle and an energy that grow with time."""
    motion, t = problem.motion(), problem.t / problem.duration
    half = 0.5 * tilt * t[:, None]
    turn = np.hstack([np.cos(half), np.sin(half), 0 * half, 0 * half])
    zero = np.zeros(len(problem.grid))
    return Simulated(
        motion.position + by * t[:, None] * [1.0, 0.0, 0.0],
        simulation.times(turn, motion.unit_quaternion),
        motion.velocity,
        motion.angular_velocity,
        1.0 + np.linspace(0, 1 + energy, len(zero)),
        zero,
        np.linspace(0, 1, len(zero)),
        0.0,
        1.0,
    )


def judged(problem: Problem, results: dict[Method, Simulated | Failure], growth: float = 0.0) -> pd.DataFrame:
    motion = problem.motion()
    solution = Solution("motion", motion.position, motion.unit_quaternion, np.full(len(problem.t), growth))
    return simulation.table("id", problem, solution, {}, {("x", m): s for m, s in results.items()}, {})


PAIR = Method("kkt", "", "RK4", 1, 4), Method("kkt", "", "RK4", 2, 4)


@pytest.mark.parametrize(
    ("coarse", "fine", "wanted"),
    [
        ({"by": 1.6e-5}, {"by": 1e-6}, ["pass", "pass"]),
        ({"by": 1.6e-5}, {"by": 9e-6}, ["pass", "fail"]),  # a part that no step takes away
        ({"by": 1e-5}, {"by": 9e-6}, ["fail", "fail"]),
        ({"by": 0.0, "tilt": 1.6e-5}, {"by": 0.0, "tilt": 1e-6}, ["pass", "pass"]),
        ({"by": 0.0, "tilt": 1e-5}, {"by": 0.0, "tilt": 9e-6}, ["fail", "fail"]),
        ({"by": 0.0, "energy": 1.6e-5}, {"by": 0.0, "energy": 1e-6}, ["pass", "pass"]),
        ({"by": 0.0, "energy": 1e-4}, {"by": 0.0, "energy": 1e-4}, ["fail", "fail"]),
        ({"by": math.nan}, {"by": 0.0}, ["fail", "fail"]),
        ({"by": 0.0}, {"by": math.nan}, ["fail", "fail"]),
        ({"by": 9.0}, {"by": 0.5}, ["unsupported", "unsupported"]),
    ],
)
def test_steps_are_held_to_the_law_of_their_order(
    coarse: dict[str, float], fine: dict[str, float], wanted: list[str], hexapod: Scene
) -> None:
    problem = pose(hexapod, 0.5, 3)
    table = judged(problem, {PAIR[0]: fake(problem, **coarse), PAIR[1]: fake(problem, **fine)})
    assert table["verdict"].tolist() == wanted, table["reason"].tolist()
    if wanted == ["pass", "pass"] and coarse["by"]:
        np.testing.assert_allclose(table["order"], 4.0, atol=1e-6)


def test_where_the_law_says_nothing_nothing_is_judged(hexapod: Scene) -> None:
    """An error that passes a tenth of a leg on the way: what came before is judged, and when that ends is said."""
    problem = pose(hexapod, 0.5, 51)
    table = judged(problem, {PAIR[0]: fake(problem, 0.32), PAIR[1]: fake(problem, 0.02)})
    assert table["verdict"].tolist() == ["pass", "pass"]
    until = table["judged_until"]
    assert 0.05 < until[0] < 0.3
    assert until[1] == 0.5
    wrong = judged(problem, {PAIR[0]: fake(problem, 0.32), PAIR[1]: fake(problem, 0.3)})
    assert wrong["verdict"].tolist() == ["fail", "fail"]


def test_a_law_that_ends_early_wants_the_order_too(hexapod: Scene) -> None:
    """Both runs lost, each its own way: no error is beyond a law that wide, but it is no law of order 4."""
    problem = pose(hexapod, 0.5, 51)
    table = judged(problem, {PAIR[0]: fake(problem, 3.0), PAIR[1]: fake(problem, -2.0)})
    assert table["verdict"].tolist() == ["fail", "fail"]
    assert "expected 4" in table["reason"][0]


@pytest.mark.parametrize(("jump", "verdict"), [(4e-7, "pass"), (8e-7, "fail")])
def test_the_first_ten_steps_follow_no_order_yet(jump: float, verdict: str, hexapod: Scene) -> None:
    """The larger step is 1/120 s, so that what is allowed after 0.1 s, 6e-7 m, is so from the start, and no more."""
    problem = pose(hexapod, 0.5, 21)
    coarse, fine = fake(problem, 1.6e-5), fake(problem, 1e-6)
    fine.position[1, 0] += jump  # after 0.025 s; the law alone would allow 1.5e-7 m there
    table = judged(problem, {PAIR[0]: coarse, PAIR[1]: fine})
    assert table["verdict"][1] == verdict, table["reason"].tolist()


def test_a_run_without_its_partner_has_no_law(hexapod: Scene) -> None:
    problem = pose(hexapod, 0.5, 3)
    table = judged(problem, {PAIR[0]: fake(problem, 1e-6), PAIR[1]: Failure("fell over")})
    assert table["verdict"].tolist() == ["unsupported", "error"]
    assert table["reason"].tolist() == ["the run with the other step, which gives the law, failed", "fell over"]


@pytest.mark.parametrize(
    ("how", "growth", "verdict"),
    [
        ({"by": 5e-12}, 0.0, "pass"),
        ({"by": 1e-10}, 0.0, "fail"),
        ({"by": 0.0, "tilt": 1e-10}, 0.0, "fail"),
        ({"by": 1e-10}, 5.0, "pass"),  # e^10 times more after 2 s, of which a thousand is easy
        ({"by": 1e-9}, 5.0, "fail"),
        ({"by": 0.0, "energy": 1e-10}, 3.0, "fail"),
        ({"by": math.nan}, 0.0, "fail"),
    ],
)
def test_the_solution_is_held_to_round_off(how: dict[str, float], growth: float, verdict: str, hexapod: Scene) -> None:
    problem = pose(hexapod, 2.0, 2)
    table = judged(problem, {Method("closed_form", "", "DOP853"): fake(problem, **how)}, growth)
    assert table["verdict"].tolist() == [verdict]


def test_wrong_accelerations_fail(hexapod: Scene) -> None:
    problem = pose(hexapod, 0.5, 3)
    motion = problem.motion()
    solution = Solution("motion", motion.position, motion.unit_quaternion, np.zeros(3))
    method = Method("closed_form", "", "DOP853")
    results: dict[simulation.Row, Simulated | Failure] = {("x", method): fake(problem, 0.0)}
    for share, verdict in ((0.9, "pass"), (1.1, "fail"), (math.nan, "fail")):
        given = {("x", "closed_form"): simulation.Accelerated(1e-13, 1e-13, share)}
        assert simulation.table("id", problem, solution, {}, results, given)["verdict"].tolist() == [verdict]


# --- Failures ---------------------------------------------------------------------------------------------------------

PLUGIN = """
import os, signal, time
from stewart_crosscheck.crosscheck.engines.analytic_ import AnalyticEngine
from stewart_crosscheck.crosscheck.stepping import Method

class Base(AnalyticEngine):
    package, route = "numpy", "kkt"
    @classmethod
    def methods(cls, problem):
        return (Method("kkt", "", "none"),)

class Hang(Base):
    def simulate(self, problem, method):
        time.sleep(60)

class Killed(Base):
    @classmethod
    def methods(cls, problem):
        return (Method("kkt", "", "none"), Method("kkt", "", "other"))
    def simulate(self, problem, method):
        if method.integrator == "none":
            os.kill(os.getpid(), signal.SIGKILL)
        return super().simulate(problem, method)

class Crash(Base):
    def simulate(self, problem, method):
        os.write(2, b"engine: about to fall over\\n")
        os.abort()

class Nothing(Base):
    def simulate(self, problem, method):
        return None

class Lost(Base):
    def simulate(self, problem, method):
        s = super().simulate(problem, method)
        s.position[-1, 0] = float("nan")
        return s

class Few(Base):
    def simulate(self, problem, method):
        s = super().simulate(problem, method)
        object.__setattr__(s, "velocity", s.velocity[:1])
        return s
"""


@pytest.fixture
def plugins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Engines of another distribution that all fail, each in its own way."""
    (tmp_path / "falling_engines.py").write_text(PLUGIN)
    info = tmp_path / "falling_engines-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: falling-engines\nVersion: 1.0\n")
    names = ("hang", "killed", "crash", "nothing", "lost", "few")
    entries = [f"{name} = falling_engines:{name.capitalize()}" for name in names]
    (info / "entry_points.txt").write_text(
        "[stewart_crosscheck.engines]\n" + "\n".join([*entries, "broken = no_such_module:Engine"]) + "\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    yield
    sys.modules.pop("falling_engines", None)


@pytest.mark.usefixtures("plugins")
def test_a_failure_is_that_engines_alone(hexapod: Scene) -> None:
    report = simulate(pose(hexapod, 0.02, 3), ["killed", "crash", "nothing", "lost", "few", "broken"])
    table = report.simulation.set_index("engine")
    reasons = table[table["verdict"] == "error"]["reason"].to_dict()
    assert reasons == {
        "killed": "its process was killed by SIGKILL (by someone, or for want of memory)",
        "crash": "its process died: SIGABRT; it last printed: engine: about to fall over",
        "nothing": "nothing: got NoneType, expected a Simulated",
        "lost": "lost: position is not finite at sample 2",
        "few": "few: velocity: got shape (1, 3), expected shape (3, 3)",
        "broken": "missing package: No module named 'no_such_module'",
    }
    assert list(table.loc[["killed"], "verdict"]) == ["error", "pass"]  # the next task has a new process
    assert verdicts(report)["analytic", "closed_form"] == {"pass"}
    assert report.status == 3
    assert {f["engine"]: f["reason"] for f in report.info["failed"]} == reasons
    assert report.info["crashed"] == ["crash", "killed"]


@pytest.mark.usefixtures("plugins")
def test_an_engine_that_hangs_is_late(hexapod: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """The limit is so short that on a busy machine others may be late too."""
    monkeypatch.setattr(tasks, "SECONDS", 2.0)
    monkeypatch.setattr(tasks, "SECONDS_PER_SECOND", 0.0)
    report = simulate(pose(hexapod, 0.02, 3), ["hang"])
    late = report.simulation.set_index("engine").loc["hang"]
    assert (late["verdict"], late["reason"]) == ("error", "no answer within 2 s")
    assert report.status == 3
    assert report.info["crashed"] == []
    assert not multiprocessing.active_children()


def test_without_certified_forces_accelerations_are_an_error(hexapod: Scene, tmp_path: Path) -> None:
    (tmp_path / "flint.py").write_text("raise ModuleNotFoundError('No module named flint')")
    done = crosscheck(tmp_path, "hexapod", "--engine", "mujoco", "--duration", "0.05", "--samples", "2")
    assert done.returncode == 3, done.stderr
    rows = pd.read_csv(tmp_path / "out" / "simulation.csv", keep_default_na=False)
    by_route = rows.groupby("route")["verdict"].agg(set).to_dict()
    assert by_route == {"closed_form": {"error"}, "dae": {"error"}, "kkt": {"error"}, "native": {"pass"}}
    assert set(rows["reason"]) == {
        "",
        "accelerations: no certified driving forces: missing package: No module named flint",
    }


@pytest.mark.parametrize("engine_name", ["mujoco"], indirect=True)
def test_the_control_of_mujoco_is_put_back(engine_name: str, hexapod: Scene) -> None:
    problem = pose(hexapod, 0.01, 2)
    engine: Any = stepping_engine(engine_name, hexapod)
    engine.simulate(problem, engine.methods(problem)[2])
    assert engine.mj.get_mjcb_control() is None


@pytest.mark.parametrize("engine_name", ["dart"], indirect=True)
def test_what_is_global_in_dart_is_put_back(engine_name: str, hexapod: Scene) -> None:
    problem = pose(hexapod, 0.01, 2)
    engine: Any = stepping_engine(engine_name, hexapod)
    joint = engine.dart.constraint.BallJointConstraint
    before = joint.getErrorReductionParameter(), joint.getConstraintForceMixing()
    engine.simulate(problem, engine.methods(problem)[2])
    assert (joint.getErrorReductionParameter(), joint.getConstraintForceMixing()) == before


# --- The command ------------------------------------------------------------------------------------------------------


def crosscheck(cwd: Path, *args: str) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(cwd), os.environ.get("PYTHONPATH", "")])
    return subprocess.run(
        [sys.executable, "-m", "stewart_crosscheck.crosscheck", "simulate", *args, "--out", "out"],
        env=os.environ | {"PYTHONPATH": path},
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_command_writes_its_files(tmp_path: Path) -> None:
    done = crosscheck(tmp_path, "planar3", "--engine", "pinocchio", "--duration", "0.1", "--samples", "3")
    assert done.returncode == 0, done.stderr
    assert {file.name for file in (tmp_path / "out").iterdir()} == {"states.csv", "simulation.csv", "run.json"}
    table = pd.read_csv(tmp_path / "out" / "simulation.csv")
    assert list(table.columns) == SIMULATION_COLUMNS
    assert table["dt"].isna().tolist() == [True, True, False, False, False, False]
    states = pd.read_csv(tmp_path / "out" / "states.csv", dtype=str)
    assert list(states.columns) == STATES_COLUMNS
    start = along(load_scene("planar3"), np.zeros(1))
    assert [float(x) for x in states.iloc[0][["p_x", "p_y", "p_z"]]] == start.position[0].tolist()  # 17 digits
    info = json.loads((tmp_path / "out" / "run.json").read_text())
    assert info["status"] == 0
    assert info["without_simulation"] == ["reference"]
    assert info["growth"]["max_rate"] > 1.0
    assert "a small error grows" in done.stdout
    assert "all agree: 5 pass, 1 unsupported" in done.stdout
    assert "reference: no simulation" in done.stdout
    assert max(len(line) for line in done.stdout.splitlines() if "UNSUPPORTED" not in line) <= 90


def test_a_scene_that_poses_no_problem_names_the_field(hexapod: Scene) -> None:
    with pytest.raises(TrajectoryError, match=r"hexapod: forces: missing, expected a \[forces\] or a \[motion\] table"):
        pose(with_tables(hexapod, motion=None))
    forces = {"legs": [{"c0": 1.0}] * 6}
    with pytest.raises(TrajectoryError, match=r"initial: missing, expected an \[initial\] or a \[motion\] table"):
        pose(with_tables(hexapod, motion=None, forces=forces))
    steep = {"position": [0.947, 1.0, 0.683], "orientation": {"kind": "rotation_vector", "angles": [0, 0, 0]}}
    data = with_tables(hexapod, motion=None, forces=forces, initial=steep).model_dump(exclude_none=True, by_alias=True)
    data["platform"]["pins"] = [[0.0, 0.0, 0.0], *data["platform"]["pins"][1:]]
    with pytest.raises(TrajectoryError, match=r"initial: t = 0 s: singular pose: .*leg 1"):
        pose(Scene.model_validate(data))


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("--duration", "0"), "got '0', expected seconds, more than 0 and at most 3600"),
        (("--duration", "nan"), "got 'nan', expected seconds"),
        (("--duration", "4000"), "at most 3600"),
        (("--samples", "1"), "got '1', expected a whole number from 2 to"),
        (("--engine", "ode"), "got an unknown engine 'ode'"),
    ],
)
def test_bad_values_are_refused(args: tuple[str, ...], message: str, tmp_path: Path) -> None:
    done = crosscheck(tmp_path, *args)
    assert done.returncode == 2
    assert message in done.stderr
    assert not (tmp_path / "out").exists()


def test_the_reference_has_no_simulation() -> None:
    assert not simulates(load_engine("reference"))
