"""Each engine is driven into what it is known to do in silence, and the adapter answers with an EngineError.

LAPACK gives 1e18 N at a singular pose
    a_singular_platform_has_no_forces, lapack_says_nothing, a_singular_sample_among_good_ones_is_named
A vertical leg, or one without length: forces without a digit, q_o'' = 0
    a_leg_without_length_has_no_forces, a_vertical_leg_has_no_forces, a_vertical_leg_does_not_accelerate,
    an_inertia_that_is_rounding_turns_no_leg
Bodies without mass, or of negative mass: NaN, or numbers
    a_body_without_mass_has_no_motion, a_body_of_negative_mass_has_no_motion,
    masses_that_leave_no_digits_are_refused
States and forces that are not finite: DART puts in identities and zeros, MuJoCo controls of zero
    what_is_not_finite_is_no_state, what_is_not_finite_is_no_force, controls_that_mujoco_zeroes_are_seen_by_its_warning
Open loops: DART closes another mechanism, MuJoCo pulls them together, or takes an anchor from its own pose
    a_solver_is_not_given_open_loops, a_simulation_starts_closed, an_anchor_of_mujocos_own_pose_is_refused
MuJoCo clamps controls, begins again at its own pose, calls anybody's callbacks
    a_motor_that_mujoco_limits_is_refused, a_slide_that_mujoco_limits_is_refused, a_reset_of_mujoco_is_no_state,
    somebody_elses_callbacks_change_nothing, every_callback_of_mujoco_is_known
DART keeps another time step, ERP or CFM, and lets joints stand still where velocities overflow
    a_time_step_that_dart_does_not_take_is_refused, a_softness_that_dart_does_not_take_is_refused,
    accelerations_that_dart_sets_to_zero_are_no_answer, a_simulation_that_dart_stops_is_no_motion
What is global in a process stays changed, or was changed by somebody else
    what_is_global_in_dart_is_put_back_while_the_exception_lives, precision_of_flint_is_neither_taken_nor_left
An engine that has warned once, or holds a NaN
    an_engine_that_has_refused_answers_the_next_question
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_engines import hard_scene
from test_native import engine_of, scaled, truth_of

from stewart_crosscheck.crosscheck.engine import DynamicsResult, EngineError, load_engine
from stewart_crosscheck.crosscheck.kkt import State
from stewart_crosscheck.crosscheck.problem import Staged, pose
from stewart_crosscheck.crosscheck.trajectory import Trajectory, along, from_scene
from stewart_crosscheck.models import Scene, load_scene, write_models

MUJOCO, PINOCCHIO, DART = (
    pytest.mark.parametrize("engine_name", [name], indirect=True) for name in ("mujoco", "pinocchio", "dart")
)
URDF = pytest.mark.parametrize("engine_name", ["pinocchio", "dart"], indirect=True)


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """MuJoCo writes a file of its warnings where it is."""
    monkeypatch.chdir(tmp_path)


# --- Singular platforms -----------------------------------------------------------------------------------------------


def hexagons(hexapod: Scene, yaw: float, similar: bool = False, turning: float = 0.0) -> Scene:
    """Two level hexagons of pins, that of the platform above the hull's: singular at 90 degrees, or if similar."""
    hull = [-15, 15, 105, 135, 225, 255]
    platform = hull if similar else [-45, 45, 75, 165, 195, 285]
    data = hexapod.model_dump(by_alias=True)
    for table, radius, angles in (("hull", 0.9, hull), ("platform", 0.45, platform)):
        data[table]["pins"] = [(radius * np.cos(x), 0.0, radius * np.sin(x)) for x in np.deg2rad(angles)]
    rise = {"c0": 0.95, "terms": [[0.05, 3.7, 0.4]]}
    data["motion"] = {
        "duration": 2.0,
        "position": [{"c0": 0.05 if similar else 0.0}, rise, {"c0": 0.0}],
        "orientation": {
            "kind": "rotation_vector",
            "components": [{"c0": 0.0}, {"c0": yaw, "terms": [[turning, 2.0, 0.0]]}, {"c0": 0.0}],
        },
    }
    return Scene.model_validate(data)


def moments(scene: Scene, samples: int) -> Trajectory:
    """The scene's motion around t = 0, singular poses among them."""
    return along(scene, np.linspace(-0.5, 0.5, samples), inverse=False)


SINGULAR: dict[str, Callable[[Scene], Scene]] = {
    "yaw of 90 degrees": lambda hexapod: hexagons(hexapod, np.pi / 2),
    "yaw of 90 degrees less 1e-13": lambda hexapod: hexagons(hexapod, np.pi / 2 - 1e-13),
    "similar hexagons": lambda hexapod: hexagons(hexapod, 0.3, similar=True),
}
PARALLEL = r"sample (\d+), leg [1-6]: condition of the platform's equations = (\S+), expected at most 1e\+12"


@pytest.mark.parametrize("samples", [1, 3, 21])
@pytest.mark.parametrize("pose", SINGULAR)
def test_a_singular_platform_has_no_forces(engine_name: str, pose: str, samples: int, hexapod: Scene) -> None:
    """Few samples are solved as a whole, many leg by leg."""
    scene = SINGULAR[pose](hexapod)
    engine, motion = engine_of(engine_name, scene), moments(scene, samples)
    state = engine.state(motion)
    for asked in (
        lambda: engine.inverse_dynamics(motion),
        lambda: engine.driving_forces(state),
        lambda: engine.all_reactions(state),
    ):
        with pytest.raises(EngineError, match=rf"^{engine_name}: {PARALLEL}") as error:
            asked()
        found = re.search(PARALLEL, str(error.value))
        assert found
        assert 1e13 < float(found[2])


def test_lapack_says_nothing(engine_name: str, hexapod: Scene) -> None:
    """The failure is there: the same solve without a look at the condition gives finite forces, and no error."""
    scene = SINGULAR["yaw of 90 degrees"](hexapod)
    engine = engine_of(engine_name, scene)
    tau, J, *_ = engine.assemble(engine.state(moments(scene, 3)))
    K = np.concatenate([np.broadcast_to(engine.layout.pushes[0], (3, 24, 6)), J.transpose(0, 2, 1)], axis=2)
    F = np.linalg.solve(K, tau[..., None])[:, :6, 0]
    assert np.isfinite(F).all()
    assert np.abs(F).max() > 1e15  # N; the platform weighs 300


@pytest.mark.parametrize("samples", [5, 21])
def test_a_singular_sample_among_good_ones_is_named(engine_name: str, samples: int, hexapod: Scene) -> None:
    scene = hexagons(hexapod, np.pi / 2, turning=0.3)
    motion = moments(scene, samples)
    engine = engine_of(engine_name, scene)
    with pytest.raises(EngineError, match=rf"^{engine_name}: {PARALLEL}") as error:
        engine.inverse_dynamics(motion)
    assert f"sample {samples // 2}," in str(error.value)
    good = np.arange(samples) != samples // 2
    assert np.isfinite(engine.inverse_dynamics(motion.at(np.flatnonzero(good))).F).all()


@pytest.mark.parametrize("samples", [1, 21])
def test_a_platform_that_is_hard_is_answered(engine_name: str, samples: int, hexapod: Scene) -> None:
    """Condition 3.6e11: what is below the limit has the digits that it leaves."""
    scene = hexagons(hexapod, np.pi / 2 - 1e-11)
    motion = moments(scene, samples)
    truth = truth_of(scene, motion).F
    F = engine_of(engine_name, scene).inverse_dynamics(motion).F
    assert np.abs(F - truth).max() < 1e-16 * 3.7e11 * 10 * np.abs(truth).max()  # ten roundings of the matrix


@pytest.mark.parametrize("samples", [1, 21])
def test_two_legs_in_one_line_are_no_singularity_that_is_refused(engine_name: str, samples: int) -> None:
    """Undetermined samples keep what is determined; a hair beside the line all is lost."""
    scene = load_scene("collinear")
    motion = from_scene(scene, samples)
    assert motion.undetermined.all()
    engine = engine_of(engine_name, scene)
    assert np.isfinite(engine.inverse_dynamics(motion).F).all()
    beside = dict(motion.q)
    beside["n1"] = beside["n1"] + 1e-14
    with pytest.raises(EngineError, match=r"condition of the platform's equations|no forces give|got rank"):
        engine.inverse_dynamics(replace(motion, q=beside, undetermined=np.zeros(samples, dtype=bool)))


# --- Vertical legs, masses --------------------------------------------------------------------------------------------


def with_angle(motion: Trajectory, leg: int, sample: int, angle: float) -> Trajectory:
    """A motion with one q_n set: its loop is open there, which forces do not ask for."""
    q = {name: x.copy() for name, x in motion.q.items()}
    q[f"n{leg}"][sample] = angle
    return replace(motion, q=q)


@pytest.mark.parametrize("samples", [3, 21])
@pytest.mark.parametrize("angle", [0.0, 1e-13, -1e-13])
def test_a_vertical_leg_has_no_forces(engine_name: str, samples: int, angle: float, hexapod: Scene) -> None:
    motion = with_angle(from_scene(hexapod, samples), 3, 1, angle)
    engine = engine_of(engine_name, hexapod)
    with pytest.raises(EngineError, match=rf"^{engine_name}: sample 1, leg 3: sin q_n = \S+, expected at least 1e-12"):
        engine.inverse_dynamics(motion)
    engine.driving_forces(engine.state(with_angle(motion, 3, 1, 1e-11)))


@pytest.mark.parametrize("samples", [3, 21])
@pytest.mark.parametrize("L", [0.0, 1e-13])
@pytest.mark.parametrize("name", ["hexapod", "planar3"])
def test_a_leg_without_length_has_no_forces(engine_name: str, name: str, L: float, samples: int) -> None:
    scene = load_scene(name)
    motion, engine = from_scene(scene, samples), engine_of(engine_name, scene)

    def shorter(L: float) -> Trajectory:
        q = {c: x.copy() for c, x in motion.q.items()}
        q["s3"][1] = L - scene.leg.a
        return replace(motion, q=q)

    with pytest.raises(
        EngineError, match=r"sample 1, leg 3: length over the longest lever = \S+, expected at least 1e-12"
    ):
        engine.driving_forces(engine.state(shorter(L)))
    engine.driving_forces(engine.state(shorter(1e-9)))


@pytest.mark.parametrize("angle", [0.0, 1e-13])
def test_a_vertical_leg_does_not_accelerate(
    engine_name: str, angle: float, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    """The engine's own solver gives finite numbers there, with q_o'' = 0 or far off."""
    engine = engine_of(engine_name, hexapod)
    state = engine.state(with_angle(trajectory, 3, 1, angle).without_accelerations())
    if engine_name != "dart":  # which would not close its loops at sample 1, but at sample 0
        assert np.isfinite(engine.solved(State(*(x[1:2] for x in state)), truth.F[1:2])).all()
    for asked in (engine.accelerate, engine.hard):
        with pytest.raises(EngineError, match=r"sample 1, leg 3: sin q_n = \S+, expected at least 1e-12"):
            asked(state, truth.F)


@pytest.mark.parametrize(("distance", "refused"), [(1e-3, False), (1e-8, True)])
def test_an_inertia_that_is_rounding_turns_no_leg(
    engine_name: str, distance: float, refused: bool, hexapod: Scene
) -> None:
    """Slender legs without bases: about o there is L^2 sin^2 q_n of mass, which the mass matrix loses."""
    data = hexapod.model_dump(by_alias=True)
    data["leg"]["base"] = None
    data["leg"]["guide"]["J_y"] = data["leg"]["rod"]["J_z"] = 0.0
    scene, motion = hard_scene(Scene.model_validate(data), "steep", distance)
    engine, F = engine_of(engine_name, scene), truth_of(scene, motion).F
    if not refused:
        assert np.isfinite(engine.accelerate(engine.state(motion), F)).all()
        return
    for asked in (lambda: engine.accelerate(engine.state(motion), F), lambda: engine.forward_dynamics(motion, F)):
        with pytest.raises(EngineError, match="sample 0, leg 1: inertia about o over that about n = "):
            asked()


def heavier(models: dict[str, str], body: str, mass: float) -> dict[str, str]:
    """URDF with another mass of one link, inertia in proportion."""
    link = rf'(<link name="{body}">.*?<mass value=")([^"]*)(" />\s*<inertia )([^>]*)'

    def changed(found: re.Match[str]) -> str:
        inertia = re.sub(r'"([^"]*)"', lambda x: f'"{float(x[1]) * mass / float(found[2])}"', found[4])
        return found[1] + str(mass) + found[3] + inertia

    out = {name: re.sub(link, changed, text, count=1, flags=re.DOTALL) for name, text in models.items()}
    assert out != models
    return out


@URDF
def test_a_body_without_mass_has_no_motion(
    engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    models = write_models(hexapod)
    for body in ("base2", "guide2", "rod2"):
        models = heavier(models, body, 0.0)
    engine = engine_of(engine_name, hexapod, models)
    state = engine.state(trajectory)
    with pytest.raises(EngineError, match=rf"^{engine_name}: sample 0: the mass matrix is singular$"):
        engine.accelerate(state, truth.F)
    with pytest.raises(EngineError, match=rf"^{engine_name}: sample 0: the mass matrix is singular$"):
        engine.forward_dynamics(trajectory, truth.F)
    if engine_name == "pinocchio":
        with pytest.raises(EngineError, match="a is not finite at sample 0"):
            engine.solved(state, truth.F)


@URDF
def test_a_body_of_negative_mass_has_no_motion(
    engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    """J M^-1 J^T is regular, with small numbers, and not definite."""
    engine = engine_of(engine_name, hexapod, heavier(write_models(hexapod), "platform", -3.0))
    with pytest.raises(EngineError, match=r"sample 0: the loops' matrix J M\^-1 J\^T is singular"):
        engine.accelerate(engine.state(trajectory), truth.F)


@pytest.mark.parametrize(("mass", "refused"), [(1e10, False), (1e17, True)])
def test_masses_that_leave_no_digits_are_refused(
    engine_name: str, mass: float, refused: bool, hexapod: Scene, trajectory: Trajectory
) -> None:
    """Legs so much heavier than the platform: what moves it is rounding of what moves them."""
    scene = scaled(hexapod, mass, 1.0)
    engine, F = engine_of(engine_name, scene), truth_of(scene, trajectory).F
    if not refused:
        assert np.isfinite(engine.accelerate(engine.state(trajectory), F)).all()
        return
    for asked in (engine.accelerate, engine.hard):
        with pytest.raises(EngineError, match=r"the loops' matrix J M\^-1 J\^T is singular: masses"):
            asked(engine.state(trajectory), F)


# --- What is not finite, what is open ---------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("level", ["q", "v"])
def test_what_is_not_finite_is_no_state(
    engine_name: str, level: str, value: float, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    """Given as a state of its own, where no trajectory stands before it."""
    engine = engine_of(engine_name, hexapod)
    state = engine.state(trajectory)
    getattr(state, level)[2, engine.velocity_index("s4") if engine_name != "mujoco" else 11] = value
    for asked in (
        lambda: engine.driving_forces(state),
        lambda: engine.all_reactions(State(*(x[:4] for x in state))),
        lambda: engine.accelerate(state, truth.F),
        lambda: engine.solved(state, truth.F),
    ):
        with pytest.raises(EngineError), np.errstate(invalid="ignore"):  # numpy's own warning comes before
            asked()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_no_force(
    engine_name: str, value: float, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    """DART takes accelerations of zero for it, MuJoCo controls of zero."""
    engine, F = engine_of(engine_name, hexapod), truth.F.copy()
    F[2, 3] = value
    with pytest.raises(EngineError):
        engine.solved(engine.state(trajectory), F)


def opened(motion: Trajectory, by: float) -> Trajectory:
    """With the slide of leg 4 out of place."""
    return replace(motion, q=motion.q | {"s4": motion.q["s4"] + by})


@DART
def test_a_solver_is_not_given_open_loops(
    engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    """DART takes both ends of a loop from the pose at which it is made: another mechanism, and no word of it."""
    engine = engine_of(engine_name, hexapod)
    with pytest.raises(EngineError, match=r"sample 0: the loop of leg 4 is open by 1e-06 m in the engine's model"):
        engine.solved(engine.state(opened(trajectory, 1e-6)), truth.F)


@pytest.mark.parametrize("route", [0, 2], ids=["kkt", "native"])
def test_a_simulation_starts_closed(engine_name: str, route: int, hexapod: Scene) -> None:
    problem = pose(hexapod, 0.02, 2)
    engine = engine_of(engine_name, hexapod)
    method = engine.methods(problem)[route]
    engine.simulate(problem, method)
    with pytest.raises(EngineError, match=r"sample 0: the loop of leg 4 is open by 1e-06 m in the engine's model"):
        engine.simulate(replace(problem, start=opened(problem.start, 1e-6)), method)


# --- MuJoCo -----------------------------------------------------------------------------------------------------------


@MUJOCO
@pytest.mark.parametrize(
    ("given", "got"),
    [
        ('ctrllimited="true" ctrlrange="-90 90"', "90 N from the motors, expected 7e+09 N"),
        ('forcelimited="true" forcerange="-90 90"', "90 N from the motors, expected 7e+09 N"),
        ('gear="2"', "1.4e+10 N from the motors, expected 7e+09 N"),
    ],
)
def test_a_motor_that_mujoco_limits_is_refused(engine_name: str, given: str, got: str, hexapod: Scene) -> None:
    models = write_models(hexapod)
    models["hexapod.xml"] = models["hexapod.xml"].replace('joint="s3" />', f'joint="s3" {given} />')
    with pytest.raises(
        EngineError, match=rf"^mujoco: joint s3: got {re.escape(got)}: the model limits or scales them$"
    ):
        engine_of(engine_name, hexapod, models)


@MUJOCO
def test_a_slide_that_mujoco_limits_is_refused(engine_name: str, hexapod: Scene) -> None:
    """As a URDF's limit of effort becomes one."""
    models = write_models(hexapod)
    joint = '<joint name="s3" type="slide" axis="0 1 0" '
    limited = 'actuatorfrclimited="true" actuatorfrcrange="-90 90" />'
    models["hexapod.xml"] = models["hexapod.xml"].replace(f"{joint}/>", joint + limited)
    with pytest.raises(EngineError, match=r"^mujoco: joint s3: got 90 N from the motors, expected 7e\+09 N"):
        engine_of(engine_name, hexapod, models)


@MUJOCO
def test_an_anchor_of_mujocos_own_pose_is_refused(engine_name: str, hexapod: Scene) -> None:
    """With bodies and an anchor in place of sites MuJoCo takes the other anchor from qpos0, where loops are open."""
    models = write_models(hexapod)
    text = models["hexapod.xml"]
    frozen = '<connect name="r3" body1="rod3" body2="platform" anchor="0 0.37 0" />'
    models["hexapod.xml"] = text.replace('<connect name="r3" site1="tip3" site2="pin3" />', frozen)
    with pytest.raises(EngineError, match=r"^mujoco: equality 3 is not a connect of the sites tip3 and pin3$"):
        engine_of(engine_name, hexapod, models)
    swapped = text.replace('site1="tip3" site2="pin3"', 'site1="tip4" site2="pin4"', 1)
    with pytest.raises(EngineError, match=r"^mujoco: equality 3 is not a connect"):
        engine_of(engine_name, hexapod, models | {"hexapod.xml": swapped})


@MUJOCO
def test_controls_that_mujoco_zeroes_are_seen_by_its_warning(
    engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    engine, F = engine_of(engine_name, hexapod), truth.F.copy()
    F[4, 1] = np.nan
    with pytest.raises(EngineError, match=r"^mujoco: warnings \{'mjWARN_BADCTRL': 1\}$"):
        engine.solved(engine.state(trajectory), F)


def wild(hexapod: Scene) -> Any:
    """A problem whose forces soon throw the platform out of float64."""
    data = hexapod.model_dump(by_alias=True)
    data["forces"] = {"legs": [{"c0": 9e9 * (-1) ** i} for i in range(6)]}
    return pose(Scene.model_validate(data), 0.05, 3)


@MUJOCO
def test_a_reset_of_mujoco_is_no_state(engine_name: str, hexapod: Scene) -> None:
    problem = wild(hexapod)
    engine = engine_of(engine_name, problem.scene)
    with pytest.raises(EngineError, match=r"^mujoco: warnings \{.*'mjWARN_BADQACC': \d+"):
        engine.own_steps(problem, Staged(problem, 10), 10)
    mj = engine.mj  # what it would have done
    d = mj.MjData(engine.model)
    d.qpos, d.qvel = (x[0] for x in engine.state(problem.start)[:2])
    d.ctrl[:] = problem.forces(np.zeros(1))[0]
    start = d.qpos.copy()
    for _ in range(100):
        mj.mj_step(engine.model, d)
        if d.warning.number.any():
            break
    assert d.time <= engine.model.opt.timestep  # it begins again
    assert np.isfinite(d.qpos).all()
    assert np.abs(d.qpos - start).max() > 0.1


@MUJOCO
def test_somebody_elses_callbacks_change_nothing(
    engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    engine, problem = engine_of(engine_name, hexapod), pose(hexapod, 0.02, 2)
    mj, method = engine.mj, engine.methods(problem)[2]
    want, went = engine.forward_dynamics(trajectory, truth.F), engine.simulate(problem, method)

    def push(m: Any, d: Any) -> None:
        d.qfrc_passive[:] += 3.0

    def drive(m: Any, d: Any) -> None:
        d.ctrl[:] = 5.0

    try:
        mj.set_mjcb_passive(push)
        mj.set_mjcb_control(drive)
        d = mj.MjData(engine.model)
        mj.mj_forward(engine.model, d)
        assert (d.ctrl == 5.0).all()  # they do push
        got, goes = engine.forward_dynamics(trajectory, truth.F), engine.simulate(problem, method)
        np.testing.assert_array_equal(got.reactions, want.reactions)
        np.testing.assert_array_equal(got.platform, want.platform)
        np.testing.assert_array_equal(engine.solved(engine.state(trajectory), truth.F).shape, (21, 24))
        np.testing.assert_array_equal(goes.position, went.position)
        assert (mj.get_mjcb_passive(), mj.get_mjcb_control()) == (push, drive)
        failures = []
        for asked in (
            lambda: engine.forward_dynamics(trajectory, truth.F * 1e12),
            lambda: engine.own_steps(wild(hexapod), Staged(wild(hexapod), 10), 10),
        ):
            try:
                asked()
            except EngineError as e:
                failures.append(e)  # with all its frames
            assert (mj.get_mjcb_passive(), mj.get_mjcb_control()) == (push, drive)
        assert len(failures) == 2
    finally:
        mj.set_mjcb_passive(None)
        mj.set_mjcb_control(None)


@MUJOCO
def test_every_callback_of_mujoco_is_known(engine_name: str, hexapod: Scene) -> None:
    steps = importlib.import_module("stewart_crosscheck.crosscheck.engines.mujoco_steps")
    have = {name.removeprefix("get_mjcb_") for name in dir(engine_of(engine_name, hexapod).mj) if "get_mjcb_" in name}
    assert have == set(steps.CALLBACKS)


# --- DART -------------------------------------------------------------------------------------------------------------


@DART
@pytest.mark.parametrize("dt", [0.0, -1e-6, float("nan")])
def test_a_time_step_that_dart_does_not_take_is_refused(
    engine_name: str, dt: float, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    engine = engine_of(engine_name, hexapod, time_step=dt)
    with pytest.raises(EngineError, match=r"^dart: time step: got \S+, and DART would go on with (0\.001|nan)$"):
        engine.solved(engine.state(trajectory), truth.F)


@DART
def test_a_softness_that_dart_does_not_take_is_refused(
    engine_name: str,
    hexapod: Scene,
    trajectory: Trajectory,
    truth: DynamicsResult,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem = pose(hexapod, 0.02, 2)
    engine = engine_of(engine_name, hexapod, reduction=1.5)
    with pytest.raises(EngineError, match=r"^dart: ERP: got 1.5, and DART would go on with 1$"):
        engine.own_steps(problem, Staged(problem, 10), 10)
    module = importlib.import_module(load_engine(engine_name).__module__)
    monkeypatch.setattr(module, "MIXING", 1e-12)
    with pytest.raises(EngineError, match=r"^dart: CFM: got 1e-12, and DART would go on with 1e-09$"):
        engine.solved(engine.state(trajectory), truth.F)


@DART
@pytest.mark.parametrize("force", [1e150, 1e200, 1e300])
def test_accelerations_that_dart_sets_to_zero_are_no_answer(
    engine_name: str, force: float, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    """Finite forces whose velocities overflow when they are squared: joints stand still, and all numbers are finite."""
    engine, F = engine_of(engine_name, hexapod), truth.F.copy()
    F[2, 3] = force
    with pytest.raises(EngineError, match=r"^dart: sample 2: velocities of \S+ are beyond what DART squares$"):
        engine.solved(engine.state(trajectory), F)
    sk = engine.skeleton  # as it was left
    assert np.isfinite(sk.getAccelerations()).all()
    assert (sk.getAccelerations() == 0.0).sum() >= 18


@DART
def test_a_simulation_that_dart_stops_is_no_motion(engine_name: str, hexapod: Scene) -> None:
    problem = wild(hexapod)
    engine = engine_of(engine_name, problem.scene)
    with pytest.raises(EngineError, match=r"^dart: sample \d: velocities of \S+ are beyond|is not finite"):
        engine.simulate(problem, engine.methods(problem)[2])


@DART
def test_what_is_global_in_dart_is_put_back_while_the_exception_lives(
    engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An exception keeps the frames that it went through, and a suspended generator among them keeps its settings."""
    engine = engine_of(engine_name, hexapod)
    joint: Any = engine.dart.constraint.BallJointConstraint

    def held() -> tuple[float, float]:
        return joint.getErrorReductionParameter(), joint.getConstraintForceMixing()

    before, seen = held(), []

    def fails(*_: Any) -> Any:
        seen.append(held())
        raise ZeroDivisionError

    module = importlib.import_module(load_engine(engine_name).__module__)
    monkeypatch.setattr(module, "accelerations", fails)
    problem = pose(hexapod, 0.02, 2)
    for asked in (
        lambda: engine.solved(engine.state(trajectory), truth.F),
        lambda: engine.forward_dynamics(trajectory, truth.F),
        lambda: engine.own_steps(problem, Staged(problem, 10), 10),
    ):
        with pytest.raises(ZeroDivisionError) as error:
            asked()
        assert error.tb  # with the frames that it went through
        assert held() == before
    assert [erp for erp, _ in seen] == [0.0, 0.0, 0.2]


# --- Together ---------------------------------------------------------------------------------------------------------


def test_precision_of_flint_is_neither_taken_nor_left(hexapod: Scene, trajectory: Trajectory) -> None:
    flint: Any = importlib.import_module("flint")
    one = trajectory.at(np.array([3]))
    want = load_engine("reference")(hexapod).inverse_dynamics(one)
    before = flint.ctx.prec
    try:
        for bits in (20, 777):
            flint.ctx.prec = bits
            got = load_engine("reference")(hexapod).inverse_dynamics(one)
            assert flint.ctx.prec == bits
            np.testing.assert_array_equal(got.reactions, want.reactions)
            wider = got.radius["reactions"] / np.maximum(want.radius["reactions"], 1e-300)
            assert np.abs(wider[want.radius["reactions"] > 0.0] - 1.0).max() < 2.0**-16  # rounded up to so many bits
            broken = replace(one, q=one.q, quaternion=np.full((1, 4), np.nan))
            with pytest.raises((EngineError, ArithmeticError, ValueError)):
                load_engine("reference")(hexapod).inverse_dynamics(broken)
            assert flint.ctx.prec == bits
    finally:
        flint.ctx.prec = before


def test_an_engine_that_has_refused_answers_the_next_question(
    engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    """Refusals of every kind, then the same numbers as from a fresh engine, bit for bit."""
    fresh = engine_of(engine_name, hexapod)
    want, moved = fresh.inverse_dynamics(trajectory), fresh.forward_dynamics(trajectory, truth.F)
    engine = engine_of(engine_name, hexapod)
    bad, F = engine.state(trajectory), truth.F.copy()
    bad.v[2, 5], F[4] = np.nan, np.nan
    good = engine.state(trajectory)
    for asked in (
        lambda: engine.driving_forces(bad),
        lambda: engine.accelerate(bad, truth.F),
        lambda: engine.solved(bad, truth.F),
        lambda: engine.solved(good, F),
        lambda: engine.forward_dynamics(opened(trajectory, 1e-6), truth.F),
        lambda: engine.inverse_dynamics(with_angle(trajectory, 3, 1, 0.0)),
    ):
        with pytest.raises(EngineError):
            asked()
    got, moves = engine.inverse_dynamics(trajectory), engine.forward_dynamics(trajectory, truth.F)
    np.testing.assert_array_equal(got.F, want.F)
    np.testing.assert_array_equal(got.reactions, want.reactions)
    np.testing.assert_array_equal(moves.platform, moved.platform)
    np.testing.assert_array_equal(moves.reactions, moved.reactions)


@pytest.mark.parametrize("engine_name", ["mujoco"], indirect=True)
def test_a_time_constant_that_mujoco_does_not_take_is_refused(engine_name: str) -> None:
    """Below two steps it takes two, and says nothing."""
    scene = load_scene("hanging")
    problem, engine = pose(scene, 0.02, 3), engine_of(engine_name, scene)
    method = next(m for m in engine.methods(problem) if m.route == "native")
    assert np.isfinite(engine.simulate(problem, method).position).all()
    engine.time_constant = 1.99
    with pytest.raises(EngineError, match=r"^mujoco: time constant: got 1\.99 steps, expected 2 or more"):
        engine.simulate(problem, method)
