"""Engines' own solvers: errors follow their laws, in size and slope; faults above the law are seen; guards hold."""

from __future__ import annotations

import dataclasses
import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import ENGINES
from machines import random_planar, random_scene
from test_engines import hard_scene

from stewart_crosscheck.crosscheck import compare, tolerance
from stewart_crosscheck.crosscheck.checks import Worst
from stewart_crosscheck.crosscheck.compare import NO_BOUND, agreement, expected
from stewart_crosscheck.crosscheck.engine import DynamicsResult, EngineError, load_engine, values
from stewart_crosscheck.crosscheck.native import mobility, response
from stewart_crosscheck.crosscheck.run import run
from stewart_crosscheck.crosscheck.scales import scales
from stewart_crosscheck.crosscheck.trajectory import Trajectory, from_scene
from stewart_crosscheck.models import Scene, load_scene, scene_names, write_models

INCLINED = (1.5, -9.0, -2.5)
MACHINES: dict[str, Callable[[], Scene]] = {
    **{name: lambda name=name: load_scene(name) for name in scene_names()},
    "19 bodies under load": lambda: random_scene(0, base=True, gravity=INCLINED),
    "13 bodies under load": lambda: random_scene(1, base=False, gravity=INCLINED),
    "bar under load": lambda: random_planar(1, point=False),
    "point mass under load": lambda: random_planar(2, point=True),
}


def truth_of(scene: Scene, trajectory: Trajectory) -> DynamicsResult:
    return load_engine("reference")(scene).inverse_dynamics(trajectory)


def engine_of(name: str, scene: Scene, models: dict[str, str] | None = None, **knobs: float) -> Any:
    engine: Any = load_engine(name)(scene, models)
    for knob, value in knobs.items():
        assert hasattr(engine, knob)
        setattr(engine, knob, value)
    return engine


def table(scene: Scene, trajectory: Trajectory, truth: DynamicsResult, name: str, result: Any) -> Any:
    """Rows of the route `native`, by quantity."""
    engines = {name: load_engine(name), "reference": load_engine("reference")}
    results = {(name, "native"): result, ("reference", "certified"): truth}
    rows = agreement("id", scene, trajectory, engines, results).set_index(["engine", "quantity"])
    return rows.xs(name, level="engine")


def error_and_law(
    scene: Scene, trajectory: Trajectory, truth: DynamicsResult, result: DynamicsResult, name: str
) -> tuple[np.ndarray, np.ndarray]:
    """Error over the scale at each sample, and its law: norms of vectors, largest over the legs."""
    error = compare._errors(scene, trajectory, result, truth, name).error
    law = values(scene, dataclasses.replace(result, **result.predicted), name)
    scale = scales(scene, trajectory, truth).of(name)
    return error / scale, np.linalg.norm(law, axis=2).max(axis=1) / scale


# --- Laws -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("machine", MACHINES)
def test_the_answer_lies_within_the_law_and_the_law_is_not_wide(engine_name: str, machine: str) -> None:
    """Every quantity of every scene; where the law stands clear of rounding, the error is within a tenth of it."""
    scene = MACHINES[machine]()
    trajectory = from_scene(scene, 5)
    truth = truth_of(scene, trajectory)
    result = engine_of(engine_name, scene).forward_dynamics(trajectory.without_accelerations(), truth.F)
    rows = table(scene, trajectory, truth, engine_name, result)
    assert list(rows.index) == list(expected(scene, load_engine(engine_name), "native"))
    assert set(rows["verdict"]) == {"pass"}, rows[["max_rel", "tolerance", "where"]]
    assert set(rows["tolerance_name"]) == {f"law_of_{result.law.name}"}
    # Rounding, on the one hand of first order and on the other without a law, is 1e-3 of the scale for nobody.
    widest = {"mujoco": 2e-3, "pinocchio": 1e-12, "dart": 1e-6}[engine_name]
    assert rows["tolerance"].max() < widest
    for name in rows.index:
        error, law = error_and_law(scene, trajectory, truth, result, name)
        clear = law > 100 * 2.5e-13 * np.maximum(result.amplification, result.mobility) / 40.0
        np.testing.assert_allclose(error[clear], law[clear], rtol=0.1)  # what is left is of second order


LOOSE: dict[str, dict[str, float]] = {
    "mujoco": {"impedance": 0.9999},
    "pinocchio": {"mu": 1e-5, "iterations": 1},
    "dart": {"time_step": 1e-5},
}


@pytest.mark.parametrize("machine", ["hexapod", "planar3"])
def test_the_law_has_directions_and_signs(engine_name: str, machine: str) -> None:
    """Vectors of every reaction and of the platform's accelerations, where rounding is far below."""
    scene = MACHINES[machine]()
    trajectory = from_scene(scene, 3)
    truth = truth_of(scene, trajectory)
    result = engine_of(engine_name, scene, None, **LOOSE[engine_name]).forward_dynamics(trajectory, truth.F)
    given = np.hstack([trajectory.acceleration, trajectory.angular_acceleration])
    for error, law in (
        (result.reactions - truth.reactions, result.predicted["reactions"]),
        (result.platform - given, result.predicted["platform"]),
    ):
        np.testing.assert_allclose(error, law, rtol=0, atol=0.02 * np.abs(law).max())  # second order


SWEEPS: dict[str, list[tuple[str, dict[str, float], list[float], int]]] = {
    # knob, other settings, its values, exponent in (1 - d)/d, mu or dt
    "mujoco": [("impedance", {}, [0.9, 0.99, 0.999, 0.9999], 1)],
    "pinocchio": [
        ("mu", {"iterations": 1}, [1e-4, 1e-6, 1e-8, 1e-10, 1e-12], 1),
        ("mu", {"iterations": 2}, [1e-3, 1e-4, 1e-5, 1e-6], 2),
        ("mu", {"iterations": 3}, [1e-2, 1e-3, 1e-4], 3),
    ],
    "dart": [("time_step", {}, [1e-3, 1e-4, 1e-5, 1e-6], 1)],
}


@pytest.mark.parametrize(
    ("engine_name", "sweep"), [(e, s) for e in ENGINES for s in SWEEPS[e]], indirect=["engine_name"]
)
@pytest.mark.parametrize("machine", ["hexapod", "planar3"])
def test_the_error_follows_the_law_over_decades(engine_name: str, sweep: tuple, machine: str) -> None:
    """The slope in log-log is the law's exponent within 5 %, and every point lies within a third of the law."""
    knob, others, settings, exponent = sweep
    scene = MACHINES[machine]()
    trajectory = from_scene(scene, 3)
    truth = truth_of(scene, trajectory)
    parameter = [(1 - x) / x if engine_name == "mujoco" else x for x in settings]
    for name in ("F_r", "M_s", "a", "alpha"):
        errors = []
        for setting in settings:
            engine = engine_of(engine_name, scene, **others, **{knob: setting})
            error, law = error_and_law(scene, trajectory, truth, engine.forward_dynamics(trajectory, truth.F), name)
            worst = int(np.argmax(law))
            assert 0.75 < error[worst] / law[worst] < 1.33, (name, setting)
            errors.append(error[worst])
        slope = np.polyfit(np.log(parameter), np.log(errors), 1)[0]
        assert slope == pytest.approx(exponent, rel=0.05), name


@pytest.mark.parametrize("engine_name", ["dart"], indirect=True)
@pytest.mark.parametrize("machine", ["hexapod", "planar3"])
def test_what_the_mixing_adds_follows_the_law(engine_name: str, machine: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its least value is lost below the step's error; larger ones show factor and sign. DART's rows turn with rods."""
    scene = MACHINES[machine]()
    trajectory = from_scene(scene, 3)
    truth = truth_of(scene, trajectory)
    errors, settings = [], [1e-6, 1e-5, 1e-4]
    for mixing in settings:
        monkeypatch.setattr(importlib.import_module(load_engine(engine_name).__module__), "MIXING", mixing)
        result = engine_of(engine_name, scene, time_step=1e-7).forward_dynamics(trajectory, truth.F)
        error, law = error_and_law(scene, trajectory, truth, result, "F_r")
        np.testing.assert_allclose(error, law, rtol=0.2)  # diag A is taken in world axes
        errors.append(error.max())
    assert np.polyfit(np.log(settings), np.log(errors), 1)[0] == pytest.approx(1, rel=0.05)


def scaled(scene: Scene, legs: float, platform: float) -> Scene:
    """With all masses and moments of inertia of the legs, and of the platform, times these."""
    data = scene.model_dump(by_alias=True)
    for body in ("base", "guide", "rod"):
        part = data["leg"].get(body) or {}
        part |= {name: x * legs for name, x in part.items() if name != "com"}
    own = data["platform"]
    own |= {name: (np.array(own[name]) * platform).tolist() for name in ("mass", "inertia", "J_z") if own.get(name)}
    return Scene.model_validate(data)


@pytest.mark.parametrize(
    ("legs", "platform"), [(1e6, 1e6), (1e9, 1e9), (1e6, 1.0), (1.0, 1e-6), (1e-12, 1.0), (1e12, 1.0), (1.0, 1e-12)]
)
@pytest.mark.parametrize("machine", ["hexapod", "planar3"])
def test_the_law_holds_whatever_the_masses(engine_name: str, machine: str, legs: float, platform: float) -> None:
    """Soft loops may give way by the whole, and the law says so: nothing is beyond it.

    MuJoCo's loops are as soft as it takes J M^-1 J^T at another pose to be, DART's by 1e-9 per kg whatever the masses,
    Pinocchio's by 1e-10 per kg.
    """
    scene = scaled(MACHINES[machine](), legs, platform)
    trajectory = from_scene(scene, 3)
    truth = truth_of(scene, trajectory)
    engine = engine_of(engine_name, scene)
    if engine_name == "mujoco" and legs > 1e8:
        with pytest.raises(EngineError, match=r"expected at most 1e\+10 N"):
            engine.forward_dynamics(trajectory, truth.F)
        return
    result = engine.forward_dynamics(trajectory, truth.F)
    rows = table(scene, trajectory, truth, engine_name, result)
    assert set(rows["verdict"]) <= {"pass", "unsupported"}, rows[["max_rel", "tolerance"]]
    if (engine_name, legs) == ("dart", 1e9):
        for name in ("F_r", "M_s", "a", "alpha"):
            error, law = error_and_law(scene, trajectory, truth, result, name)
            assert law.max() > 0.1 if name in ("a", "F_r") else law.max() > 1e-3  # no longer small
            np.testing.assert_allclose(error, law, rtol=0.02)


@pytest.mark.parametrize("engine_name", ["pinocchio"], indirect=True)
def test_five_proximal_steps_leave_nothing_but_rounding(
    engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    result = engine_of(engine_name, hexapod).forward_dynamics(trajectory, truth.F)
    for name in expected(hexapod, load_engine(engine_name), "native"):
        error, law = error_and_law(hexapod, trajectory, truth, result, name)
        assert law.max() < 1e-30
        assert error.max() < 1e-13  # measured 6e-15: one factorisation, condition of the mass matrix about 1e3


def test_the_response_solves_the_hard_system() -> None:
    rng = np.random.default_rng(1)
    J, half = rng.normal(size=(4, 3, 7)), rng.normal(size=(4, 7, 7))
    M = half @ half.transpose(0, 2, 1) + np.eye(7)
    force, closure = rng.normal(size=(4, 7)), rng.normal(size=(4, 3))
    da, dl = response(M, J, mobility(M, J), force, closure)
    # condition below 1e3
    np.testing.assert_allclose(np.einsum("tij,tj->ti", J, da), closure, atol=1e-12)
    np.testing.assert_allclose(np.einsum("tij,tj->ti", M, da), np.einsum("tij,ti->tj", J, dl) + force, atol=1e-12)
    np.testing.assert_allclose(mobility(M, J), J @ np.linalg.inv(M) @ J.transpose(0, 2, 1), atol=1e-12)


# --- Verdicts ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine_name", ["mujoco"], indirect=True)
def test_a_law_that_says_nothing_is_unsupported_and_says_so(engine_name: str, hexapod: Scene) -> None:
    """A moving leg, nearly vertical, is loaded by a million newtons: soft loops let the platform go its own way."""
    scene, trajectory = hard_scene(hexapod, "steep", 1e-3)
    truth = truth_of(scene, trajectory)
    result = engine_of(engine_name, scene).forward_dynamics(trajectory, truth.F)
    rows = table(scene, trajectory, truth, engine_name, result)
    assert set(rows.loc[["a", "alpha"], "verdict"]) == {"unsupported"}
    assert set(rows.loc[["a", "alpha"], "reason"]) == {NO_BOUND}
    assert set(rows.drop(["a", "alpha"])["verdict"]) == {"pass"}


@pytest.mark.parametrize(
    ("errors", "allowed", "verdict"),
    [
        ([1e-4, 9.0], [1e-3, 10.0], "unsupported"),
        ([1e-2, 9.0], [1e-3, 10.0], "fail"),  # the one that can be judged is wrong
        ([1e-4, np.nan], [1e-3, 1e-3], "fail"),
        ([1e-4, 99.0], [1e-3, 10.0], "unsupported"),  # beyond first order
        ([1e-4, 1e-4], [1e-3, 1e-3], "pass"),
    ],
)
def test_samples_without_a_bound_hide_no_failure(errors: list[float], allowed: list[float], verdict: str) -> None:
    names = np.array(["x", "x"])
    worst = Worst.of(np.array(errors)[:, None], ["leg 1"])
    row = compare._judge(worst, 1.0, np.array([0.0, 1.0]), np.array(allowed), names, "")
    assert row["verdict"] == verdict


def test_hard_poses_keep_to_the_law(engine_name: str, hexapod: Scene) -> None:
    """Forces of 1e5 and 1e9 N where two legs are nearly in one line: no fail, and no bound without need."""
    for distance in (1e-4, 1e-8):
        scene, trajectory = hard_scene(hexapod, "parallel", distance)
        truth = truth_of(scene, trajectory)
        result = engine_of(engine_name, scene).forward_dynamics(trajectory, truth.F)
        rows = table(scene, trajectory, truth, engine_name, result)
        if (engine_name, distance) == ("dart", 1e-8):  # 1e9 N, rounded, over the time step: nothing is left
            assert set(rows.loc[["a", "alpha"], "verdict"]) == {"unsupported"}
            rows = rows.drop(["a", "alpha"])
        assert set(rows["verdict"]) == {"pass"}


@pytest.mark.parametrize("engine_name", ["pinocchio"], indirect=True)
def test_without_a_law_the_answer_is_held_to_rounding(
    engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    result = engine_of(engine_name, hexapod).forward_dynamics(trajectory, truth.F)
    exact = dataclasses.replace(result, law=None, predicted={})
    rows = table(hexapod, trajectory, truth, engine_name, exact)
    assert set(rows["tolerance_name"]) == {"round_off", "round_off_ill_conditioned"}  # alpha: forces of 11 times it
    assert set(rows["verdict"]) == {"pass"}
    assert rows["tolerance"].max() < 1.2e-13
    off = dataclasses.replace(exact, platform=result.platform + 1e-10)
    rows = table(hexapod, trajectory, truth, engine_name, off)
    assert set(rows.loc[["a", "alpha"], "verdict"]) == {"fail"}


def test_accelerations_are_over_the_largest_of_a_tip(
    hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    size = scales(hexapod, trajectory, truth)
    lever = max(np.linalg.norm(p) for p in hexapod.pins)
    assert size.of("a") == size.of("loop_acc")
    assert size.of("alpha") == pytest.approx(size.of("a") / lever, rel=1e-12)
    point = load_scene("pointmass2")
    motion = from_scene(point, 3)
    assert scales(point, motion, truth_of(point, motion)).lever == truth_of(point, motion).L.max()


# --- Faults -----------------------------------------------------------------------------------------------------------


def with_fault(hexapod: Scene, kind: str, size: float) -> dict[str, str]:
    """Model texts of the hexapod with one number off: the scene itself stays."""
    data = hexapod.model_dump(by_alias=True)
    platform, leg, pins = data["platform"], data["leg"], [list(p) for p in data["hull"]["pins"]]
    if kind == "platform mass":
        platform["mass"] *= 1 + size
    elif kind == "platform inertia":
        platform["inertia"] = [[x * (1 + size) for x in row] for row in platform["inertia"]]
    elif kind == "guide inertia":
        leg["guide"]["J_x"] *= 1 + size
    elif kind == "rod mass":
        leg["rod"]["mass"] *= 1 + size
    else:
        pins[4][0] += size
        data["hull"]["pins"] = pins
    return write_models(Scene.model_validate(data))


# Relative faults, three times the smallest that is seen on the hexapod's 21 samples; a thirtieth of each is not.
FAULTS = {
    "mujoco": {"platform mass": 1e-4, "platform inertia": 1e-4, "guide inertia": 2e-3, "rod mass": 5e-5},
    "dart": {"platform mass": 2e-8, "platform inertia": 3e-6, "guide inertia": 5e-6, "rod mass": 5e-8},
    "pinocchio": {"platform mass": 3e-13, "platform inertia": 5e-12, "guide inertia": 1e-10, "rod mass": 5e-13},
}


@pytest.mark.parametrize("kind", FAULTS["dart"])
def test_a_fault_above_the_law_is_seen(
    engine_name: str, kind: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    verdicts = []
    for share in (1.0, 1 / 30):
        models = with_fault(hexapod, kind, share * FAULTS[engine_name][kind])
        result = engine_of(engine_name, hexapod, models).forward_dynamics(trajectory, truth.F)
        verdicts.append(set(table(hexapod, trajectory, truth, engine_name, result)["verdict"]))
    assert "fail" in verdicts[0]
    assert verdicts[1] == {"pass"}


def test_a_hull_pin_out_of_place_is_an_open_loop(
    engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    engine = engine_of(engine_name, hexapod, with_fault(hexapod, "hull pin", 1e-6))
    with pytest.raises(EngineError, match=r"sample 0: the loop of leg 5 is open by 1e-06 m in the engine's model"):
        engine.forward_dynamics(trajectory, truth.F)


def test_the_load_counts(engine_name: str) -> None:
    scene = MACHINES["19 bodies under load"]()
    trajectory = from_scene(scene, 3)
    truth = truth_of(scene, trajectory)
    unloaded = scene.model_copy(update={"load": None})
    result = engine_of(engine_name, unloaded, write_models(scene)).forward_dynamics(trajectory, truth.F)
    assert "fail" in set(table(scene, trajectory, truth, engine_name, result)["verdict"])


# --- Guards -----------------------------------------------------------------------------------------------------------


def test_the_solver_does_not_see_the_accelerations(
    engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    engine = engine_of(engine_name, hexapod)
    told, untold = (engine.forward_dynamics(x, truth.F) for x in (trajectory, trajectory.without_accelerations()))
    np.testing.assert_array_equal(told.platform, untold.platform)
    np.testing.assert_array_equal(told.reactions, untold.reactions)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_driving_forces_that_are_not_finite_are_refused(
    value: float, engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    """DART would go on with accelerations of zero, MuJoCo with controls of zero."""
    F = truth.F.copy()
    F[7, 3] = value
    with pytest.raises(EngineError, match="F is not finite at sample 7"):
        engine_of(engine_name, hexapod).forward_dynamics(trajectory, F)


@pytest.mark.parametrize("engine_name", ["mujoco"], indirect=True)
def test_driving_forces_beyond_what_mujoco_takes_are_refused(
    engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    F = truth.F.copy()
    F[7, 3] = -1.1e10
    with pytest.raises(EngineError, match=r"sample 7: got -1\.1e\+10 N for leg 4, expected at most 1e\+10 N"):
        engine_of(engine_name, hexapod).forward_dynamics(trajectory, F)


@pytest.mark.parametrize(("level", "unit"), [("q", "m"), ("v", "m/s")])
def test_a_state_with_an_open_loop_is_refused(
    level: str, unit: str, engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    """DART would close another mechanism there, MuJoCo would pull the loop together."""
    changed = dict(getattr(trajectory, level))
    changed["s4"] = changed["s4"] + np.where(np.arange(len(trajectory.t)) == 9, 1e-6, 0.0)
    broken = dataclasses.replace(trajectory, **{level: changed})
    with pytest.raises(EngineError, match=rf"sample 9: the loop of leg 4 is open by \S+e-0[67] {unit} in the engine"):
        engine_of(engine_name, hexapod).forward_dynamics(broken, truth.F)


@pytest.mark.parametrize("engine_name", ["pinocchio"], indirect=True)
def test_a_silent_nan_is_no_answer(engine_name: str) -> None:
    """Without mu the zero rows of planar loops divide by zero, and Pinocchio says nothing."""
    scene = load_scene("planar3")
    trajectory = from_scene(scene, 3)
    with pytest.raises(EngineError, match="a is not finite at sample 0"):
        engine_of(engine_name, scene, mu=0.0).forward_dynamics(trajectory, truth_of(scene, trajectory).F)


@pytest.mark.parametrize("engine_name", ["dart"], indirect=True)
def test_what_is_global_in_dart_is_set_and_put_back(
    engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    joint: Any = importlib.import_module("dartpy").constraint.BallJointConstraint
    before = joint.getErrorReductionParameter(), joint.getConstraintForceMixing()
    engine = engine_of(engine_name, hexapod)
    want = engine.forward_dynamics(trajectory, truth.F)
    terms = engine.terms(engine.state(trajectory))
    try:
        joint.setErrorReductionParameter(0.25)
        joint.setConstraintForceMixing(0.125)
        got = engine.forward_dynamics(trajectory, truth.F)
        np.testing.assert_array_equal(got.platform, want.platform)
        in_the_steps, sets = [False], engine.set

        def fails(state: Any, k: int) -> None:
            in_the_steps[0] = joint.getErrorReductionParameter() == 0.0
            if in_the_steps[0]:
                raise ZeroDivisionError
            sets(state, k)

        monkeypatch.setattr(engine, "set", fails)
        monkeypatch.setattr(engine, "terms", lambda state: terms)
        with pytest.raises(ZeroDivisionError):
            engine.forward_dynamics(trajectory, truth.F)
        assert in_the_steps[0]
        assert (joint.getErrorReductionParameter(), joint.getConstraintForceMixing()) == (0.25, 0.125)
    finally:
        joint.setErrorReductionParameter(before[0])
        joint.setConstraintForceMixing(before[1])


def test_both_routes_do_not_disturb_each_other(
    engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    """One engine, native first and again: the same numbers as from fresh ones, bit for bit."""
    engine = engine_of(engine_name, hexapod)
    first = engine.forward_dynamics(trajectory, truth.F)
    kkt = engine.inverse_dynamics(trajectory)
    again = engine.forward_dynamics(trajectory, truth.F)
    np.testing.assert_array_equal(first.reactions, again.reactions)
    fresh = engine_of(engine_name, hexapod).inverse_dynamics(trajectory)
    np.testing.assert_array_equal(kkt.reactions, fresh.reactions)
    np.testing.assert_array_equal(kkt.F, fresh.F)


# --- In a run ---------------------------------------------------------------------------------------------------------

PLUGIN = """
import os
import numpy as np
from stewart_crosscheck.crosscheck.engine import DynamicsResult
from stewart_crosscheck.crosscheck.engines.analytic_ import AnalyticEngine

class Half(AnalyticEngine):
    name, package, route, forward_route = "half", "numpy", "closed_form", "native"
    def forward_dynamics(self, trajectory, F):
        os.write(2, b"no way forward\\n")
        os.abort()

class Bare(Half):
    name = "bare"
    def forward_dynamics(self, trajectory, F):
        return DynamicsResult("bare", "", "native", "", np.arange(len(F)), F, np.zeros((len(F), 24, 6)), F, F)
"""


@pytest.fixture
def plugins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    (tmp_path / "half_engines.py").write_text(PLUGIN)
    info = tmp_path / "half_engines-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: half-engines\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[stewart_crosscheck.engines]\nhalf = half_engines:Half\nbare = half_engines:Bare\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    yield
    sys.modules.pop("half_engines", None)


@pytest.mark.usefixtures("plugins")
def test_a_route_that_fails_is_that_routes_alone(hexapod: Scene) -> None:
    report = run(hexapod, from_scene(hexapod, 3), ["half", "bare"])
    verdicts = report.agreement.groupby(["engine", "route"])["verdict"].agg(set).to_dict()
    assert verdicts["half", "closed_form"] == {"pass"}
    assert verdicts["half", "native"] == verdicts["bare", "native"] == {"error"}
    failed = report.info["failed"]
    assert failed["half"] == {"native": "its process died: SIGABRT; it last printed: no way forward"}
    assert failed["bare"] == {"native": "bare: platform: got shape (), expected shape (3, 6)"}
    of_half = (report.agreement["engine"] == "half") & (report.agreement["route"] == "native")
    assert report.agreement[of_half]["quantity"].tolist() == [*hexapod.quantities[1:], "F_hull", "M_hull", "a", "alpha"]
    assert report.status == 3


@pytest.mark.parametrize("engine_name", ["pinocchio"], indirect=True)
def test_beyond_a_thousand_samples_the_forces_are_those_of_the_truth(engine_name: str) -> None:
    scene = load_scene("pointmass2")
    report = run(scene, from_scene(scene, 1200), [engine_name])
    truth, native = report.results["reference", "certified"], report.results[engine_name, "native"]
    assert isinstance(truth, DynamicsResult)
    assert isinstance(native, DynamicsResult)
    assert 1000 <= len(truth.samples) < 1010
    np.testing.assert_array_equal(native.samples, truth.samples)
    np.testing.assert_array_equal(native.F, truth.F)
    assert report.status == 0
    table = pd.concat(report.samples())
    table = table[(table["route"] == "native") & (table["quantity"] == "a") & (table["component"] == "x")]
    assert len(table) == len(truth.samples)
    want = from_scene(scene, 1200).acceleration[truth.samples, 0]
    np.testing.assert_allclose(table["value"], want, atol=1e-12)  # m/s^2 of the order 1: rounding


def test_every_law_has_a_reason(engine_name: str, hexapod: Scene) -> None:
    engine = engine_of(engine_name, hexapod)
    assert len(engine.law.why) > 40
    assert tolerance.LAW_FACTOR == 3.0
    assert engine.forward_setting
