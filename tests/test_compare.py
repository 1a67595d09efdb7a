"""The comparison and the balance: what passes, what fails, who is named, and that nothing is left out."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from conftest import keyed
from machines import random_scene

from stewart_crosscheck.crosscheck import tolerance
from stewart_crosscheck.crosscheck.balance import balance
from stewart_crosscheck.crosscheck.compare import agreement, expected
from stewart_crosscheck.crosscheck.engine import (
    HULL,
    LOOPS,
    DynamicsResult,
    Failure,
    engine_names,
    is_forward,
    load_engine,
    routes,
)
from stewart_crosscheck.crosscheck.scales import scales
from stewart_crosscheck.crosscheck.trajectory import Trajectory, from_scene
from stewart_crosscheck.models import Scene, load_scene

ENGINES = {"analytic": load_engine("analytic"), "reference": load_engine("reference")}


@pytest.fixture(scope="module")
def results(hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult) -> dict[str, DynamicsResult]:
    return {"analytic": ENGINES["analytic"](hexapod).inverse_dynamics(trajectory), "reference": truth}


def table(hexapod: Scene, trajectory: Trajectory, results: dict) -> Any:
    return agreement("id", hexapod, trajectory, ENGINES, keyed(hexapod, trajectory, ENGINES, results)).set_index(
        ["engine", "quantity"]
    )


def spoiled(result: DynamicsResult, **changes: Any) -> DynamicsResult:
    return dataclasses.replace(result, **changes)


def test_all_rows_are_there_and_pass(hexapod: Scene, trajectory: Trajectory, results: dict) -> None:
    rows = table(hexapod, trajectory, results)
    assert list(rows.index) == [(e, q) for e in ENGINES for q in (*hexapod.quantities, *HULL)]
    assert set(rows["verdict"]) == {"pass"}
    assert (rows["max_rel"] == rows["max_abs"] / rows["scale"]).all()
    assert (rows["rms"] <= rows["max_abs"]).all()


def test_scale_is_the_largest_reaction_force_and_moments_take_the_longest_leg(
    hexapod: Scene, trajectory: Trajectory, results: dict, truth: DynamicsResult
) -> None:
    rows = table(hexapod, trajectory, results)
    force = np.linalg.norm(truth.reactions[..., 3:], axis=2).max()
    assert set(rows.loc["analytic"].loc[["F", "F_r", "F_s", "F_n", "F_o"], "scale"]) == {force}
    assert set(rows.loc["analytic"].loc[["M_s", "M_n", "M_o"], "scale"]) == {force * truth.L.max()}


def test_the_error_is_the_norm_of_a_vector_at_its_worst_leg_and_sample(
    hexapod: Scene, trajectory: Trajectory, results: dict
) -> None:
    joint = [j.name for j in hexapod.joints].index("n5")
    reactions = results["reference"].reactions.copy()
    reactions[8, joint, 3:] += [3e-4, 0.0, -4e-4]
    analytic = spoiled(results["analytic"], reactions=reactions, F=results["reference"].F)
    row = table(hexapod, trajectory, results | {"analytic": analytic}).loc[("analytic", "F_n")]
    assert row["max_abs"] == pytest.approx(5e-4, rel=1e-9)
    assert row["rms"] == pytest.approx(5e-4 / np.sqrt(21 * 6), rel=1e-9)
    assert row["verdict"] == "fail"
    assert row["where"] == f"leg 5, t = {trajectory.t[8]:.6g} s"


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_value_that_is_not_finite_never_passes(
    value: float, hexapod: Scene, trajectory: Trajectory, results: dict
) -> None:
    F = results["analytic"].F.copy()
    F[20, 5] = value
    rows = table(hexapod, trajectory, results | {"analytic": spoiled(results["analytic"], F=F)})
    assert rows.loc[("analytic", "F"), "verdict"] == "fail"
    assert rows.loc[("analytic", "F_r"), "verdict"] == "pass"


@pytest.mark.parametrize(("factor", "verdict"), [(0.9, "pass"), (1.1, "fail")])
def test_the_tolerance_cuts_where_it_says(
    factor: float, verdict: str, hexapod: Scene, trajectory: Trajectory, results: dict, truth: DynamicsResult
) -> None:
    scale = scales(hexapod, trajectory, truth).force
    F = truth.F.copy()
    F[3, 2] += factor * 1e-13 * scale
    rows = table(hexapod, trajectory, results | {"analytic": spoiled(results["analytic"], F=F)})
    assert rows.loc[("analytic", "F"), "verdict"] == verdict


def test_a_wide_radius_fails(hexapod: Scene, trajectory: Trajectory, results: dict, truth: DynamicsResult) -> None:
    wide = spoiled(truth, radius=dict(truth.radius) | {"F": truth.radius["F"] * 100})
    rows = table(hexapod, trajectory, results | {"reference": wide})
    assert rows.loc[("reference", "F"), "verdict"] == "fail"
    assert rows.loc[("reference", "F_o"), "verdict"] == "pass"


def test_a_failed_engine_has_all_its_rows(hexapod: Scene, trajectory: Trajectory, results: dict) -> None:
    rows = table(hexapod, trajectory, results | {"analytic": Failure("it broke")})
    assert set(rows.loc["analytic", "verdict"]) == {"error"}
    assert len(rows.loc["analytic"]) == 10
    assert set(rows.loc["analytic", "reason"]) == {"it broke"}
    assert set(rows.loc["reference", "verdict"]) == {"pass"}


def test_without_truth_nothing_passes(hexapod: Scene, trajectory: Trajectory, results: dict) -> None:
    rows = table(hexapod, trajectory, results | {"reference": Failure("it broke")})
    assert set(rows["verdict"]) == {"error"}
    assert set(rows.loc["analytic", "reason"]) == {"no certified truth to compare with"}


def test_a_truth_of_fewer_samples_is_compared_at_its_own(
    hexapod: Scene, trajectory: Trajectory, results: dict, truth: DynamicsResult
) -> None:
    few = np.array([2, 9, 17])
    part = spoiled(truth, samples=few, F=truth.F[few], reactions=truth.reactions[few], L=truth.L[few], dL=truth.dL[few])
    assert truth.hull is not None
    part = dataclasses.replace(part, hull=truth.hull[few])
    part = dataclasses.replace(part, radius={k: v[few] for k, v in truth.radius.items()})
    rows = table(hexapod, trajectory, results | {"reference": part})
    assert set(rows["verdict"]) == {"pass"}
    F = results["analytic"].F.copy()
    F[9] += 1.0
    rows = table(hexapod, trajectory, results | {"reference": part, "analytic": spoiled(results["analytic"], F=F)})
    assert rows.loc[("analytic", "F"), "where"].endswith(f"t = {trajectory.t[9]:.6g} s")


def test_engines_of_the_route_kkt_also_deliver_loops_and_balance(hexapod: Scene) -> None:
    for name in engine_names():
        e = load_engine(name)
        extra = (*LOOPS, "balance") if e.route == "kkt" else ()
        assert expected(hexapod, e, e.route) == (*hexapod.quantities, *HULL, *extra)


def test_the_route_native_delivers_accelerations_in_place_of_driving_forces(hexapod: Scene) -> None:
    point = load_scene("pointmass2")
    for name in engine_names():
        e = load_engine(name)
        assert is_forward(e) == (e.route == "kkt")
        assert routes(e) == ((e.route, "native") if is_forward(e) else (e.route,))
    e = load_engine("dart")
    assert expected(hexapod, e, "native") == (*hexapod.quantities[1:], *HULL, "a", "alpha")
    assert expected(point, e, "native") == (*point.quantities[1:], *HULL, "a")  # a point does not turn


# --- Balance ----------------------------------------------------------------------------------------------------------


def test_balance_closes_with_true_reactions(hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult) -> None:
    residual = balance(hexapod, trajectory, truth.reactions, float(truth.L.max()))
    assert sorted(residual) == sorted(b.name for b in hexapod.bodies)
    assert max(r.max() for r in residual.values()) < 1e-12  # N, of some hundred: rounding


@pytest.mark.parametrize(
    ("joint", "bodies"),
    [("o2", {"base2"}), ("n2", {"base2", "guide2"}), ("s2", {"guide2", "rod2"}), ("r2", {"rod2", "platform"})],
)
@pytest.mark.parametrize("component", range(6))
def test_balance_names_the_bodies_of_a_wrong_reaction(
    joint: str, bodies: set[str], component: int, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    reactions = truth.reactions.copy()
    reactions[4, [j.name for j in hexapod.joints].index(joint), component] += 1e-6
    residual = balance(hexapod, trajectory, reactions, 1.0)
    assert {name for name, r in residual.items() if r[4] > 1e-8} == bodies


@pytest.mark.parametrize("part", ["base", "guide", "rod", "platform"])
def test_balance_names_the_body_of_a_wrong_mass(
    part: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    data = hexapod.model_dump(by_alias=True)
    table_ = data["platform"] if part == "platform" else data["leg"][part]
    table_["mass"] *= 1 + 1e-6
    residual = balance(Scene.model_validate(data), trajectory, truth.reactions, float(truth.L.max()))
    wrong = {"platform"} if part == "platform" else {f"{part}{i}" for i in hexapod.legs}
    assert {name for name, r in residual.items() if r.max() > 1e-9} == wrong


# --- Tolerances -------------------------------------------------------------------------------------------------------


def test_every_tolerance_has_a_name_and_a_reason() -> None:
    named = [t for t in vars(tolerance).values() if isinstance(t, tolerance.Tolerance)]
    assert len({t.name for t in named}) == len(named) == 7
    assert all(len(t.why) > 40 and t.value > 0 for t in named)
    in_time = {"follows", "energy", "quadrature"}  # of many steps; the others are of one state
    assert all(t.value <= (1e-9 if t.name in in_time else 1e-12) for t in named)


@pytest.mark.parametrize(
    ("condition", "sin_q_n", "reach", "factor"),
    [
        (39.0, 0.02, 9.0, 1.0),
        (400.0, 0.25, 3.0, 10.0),
        (1.0, 1e-4, 3.0, 100.0),
        (4e3, 0.1, 3.0, 100.0),
        (np.nan, 0.5, np.nan, 1.0),
        (4e3, 0.1, 1e3, 1e4),
    ],
)
def test_the_tolerance_of_forces_grows_with_condition_steep_legs_and_reach(
    condition: float, sin_q_n: float, reach: float, factor: float
) -> None:
    wider = tolerance.of_forces(np.array([1.0, condition]), np.array([0.5, sin_q_n]), np.array([2.0, reach]))
    np.testing.assert_allclose(wider, [1.0, factor])


def hard_at(trajectory: Trajectory, sample: int) -> Trajectory:
    """The same trajectory, one sample of which is called hard."""
    condition = trajectory.condition.copy()
    condition[sample] = 4e9
    return dataclasses.replace(trajectory, condition=condition)


@pytest.mark.parametrize(("sample", "verdict"), [(3, "fail"), (11, "pass")])
def test_a_hard_sample_loosens_the_bound_for_itself_alone(
    sample: int, verdict: str, hexapod: Scene, trajectory: Trajectory, results: dict
) -> None:
    hard = hard_at(trajectory, 11)
    F = results["reference"].F.copy()
    F[sample, 2] += 1e-9
    row = table(hexapod, hard, results | {"analytic": spoiled(results["analytic"], F=F)}).loc[("analytic", "F")]
    assert row["verdict"] == verdict
    assert row["where"] == f"leg 3, t = {trajectory.t[sample]:.6g} s"
    assert (row["max_rel"] <= row["tolerance"]) == (verdict == "pass")
    assert row["tolerance_name"] == ("round_off" if verdict == "fail" else "round_off_ill_conditioned")


def test_balance_is_never_loosened(hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult) -> None:
    """It is a backward error: it closes to rounding however hard the pose."""
    kkt = dataclasses.replace(truth, engine="x", radius={}, loops=dict.fromkeys(LOOPS, np.zeros((21, 6, 3))))
    engines = {"mujoco": load_engine("mujoco"), "reference": ENGINES["reference"]}
    reactions = truth.reactions.copy()
    reactions[11, 0, 4] += 1e-9
    wrong = dataclasses.replace(kkt, reactions=reactions)
    rows = agreement(
        "id",
        hexapod,
        hard_at(trajectory, 11),
        engines,
        keyed(hexapod, trajectory, engines, {"mujoco": wrong, "reference": truth}),
    )
    rows = rows.set_index(["engine", "quantity"])["verdict"]
    assert rows["mujoco", "balance"] == "fail"
    assert rows["mujoco", "F_o"] == "pass"


@pytest.mark.parametrize(("factor", "verdict"), [(0.9, "pass"), (1.1, "fail")])
@pytest.mark.parametrize("level", range(3))
def test_the_tolerance_of_loops_cuts_where_it_says(
    level: int, factor: float, verdict: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    """Scales by hand: the longest leg; the fastest tip and that per second; its largest acceleration likewise."""
    R, w, dw = trajectory.rotation, trajectory.angular_velocity, trajectory.angular_acceleration
    V, A = [], []
    for p in hexapod.pins:
        r = R @ np.array(p)
        V.append(trajectory.velocity + np.cross(w, r))
        A.append(trajectory.acceleration + np.cross(dw, r) + np.cross(w, np.cross(w, r)))
    longest = truth.L.max()
    scale = (longest, np.linalg.norm(V, axis=2).max() + longest, np.linalg.norm(A, axis=2).max() + longest)[level]
    loops = {name: np.zeros((21, 6, 3)) for name in LOOPS}
    loops[LOOPS[level]][7, 4] = factor * 1e-14 * scale * np.array([0.6, 0.0, -0.8])
    kkt = dataclasses.replace(truth, radius={}, loops=loops)
    engines = {"mujoco": load_engine("mujoco"), "reference": ENGINES["reference"]}
    rows = agreement(
        "id", hexapod, trajectory, engines, keyed(hexapod, trajectory, engines, {"mujoco": kkt, "reference": truth})
    )
    rows = rows.set_index(["engine", "quantity"]).loc["mujoco"]
    assert rows.loc[LOOPS[level], "verdict"] == verdict
    assert rows.loc[LOOPS[level], "where"] == f"leg 5, t = {trajectory.t[7]:.6g} s"
    assert rows.loc[LOOPS[level], "scale"] == pytest.approx(scale, rel=1e-12)


def test_a_claimed_radius_is_no_truth(hexapod: Scene, trajectory: Trajectory, results: dict) -> None:
    """Only the reference is believed: an engine that brings radii of zero is compared like any other."""
    F = results["analytic"].F + 1.0
    liar = spoiled(results["analytic"], F=F, radius={k: 0.0 * v for k, v in results["reference"].radius.items()})
    assert table(hexapod, trajectory, results | {"analytic": liar}).loc[("analytic", "F"), "verdict"] == "fail"


def test_balance_knows_the_load() -> None:
    scene = random_scene(3, gravity=(1.0, -9.0, 2.0))
    trajectory = from_scene(scene, 5)
    truth = load_engine("reference")(scene).inverse_dynamics(trajectory)
    residual = balance(scene, trajectory, truth.reactions, float(truth.L.max()))
    assert max(r.max() for r in residual.values()) < 1e-11  # N, of some hundred: rounding
    unloaded = scene.model_copy(update={"load": None})
    assert balance(unloaded, trajectory, truth.reactions, 1.0)["platform"].min() > 0.1


def test_moments_enter_the_balance_over_the_length(
    hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    reactions = truth.reactions.copy()
    reactions[:, 0, :3] += [0.0, 0.0, 1e-3]
    for length in (0.5, 2.0):
        residual = balance(hexapod, trajectory, reactions, length)["base1"]
        np.testing.assert_allclose(residual, 1e-3 / length, rtol=1e-6)
