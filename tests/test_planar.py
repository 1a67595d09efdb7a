"""Planar mechanisms: (32)-(36) against truth, two collinear legs, what a planar scene or trajectory may not hold."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ENGINES, keyed, one_sample
from flint import arb, ctx
from machines import random_planar

from stewart_crosscheck import analytic
from stewart_crosscheck.analytic import NotDeterminate, PlanarParameters, PlatformMotion, SingularPose, stewart
from stewart_crosscheck.analytic.solve import solve_numbers
from stewart_crosscheck.analytic.stewart import PlanarLegState
from stewart_crosscheck.crosscheck.compare import agreement
from stewart_crosscheck.crosscheck.engine import DynamicsResult, EngineError, load_engine
from stewart_crosscheck.crosscheck.run import run
from stewart_crosscheck.crosscheck.samples import samples
from stewart_crosscheck.crosscheck.trajectory import Trajectory, TrajectoryError, along, from_file, from_scene
from stewart_crosscheck.crosscheck.trajectory_csv import POSE, RATES
from stewart_crosscheck.models import Scene, SceneError, load_scene
from stewart_crosscheck.models.scene import parse_scene

ROUNDING = 1e-13  # one direct solve at a condition below 30, as for spatial scenes; measured below 2e-15


def planar(scene: Scene) -> PlanarParameters:
    P = scene.parameters
    assert isinstance(P, PlanarParameters)
    return P


def truth_of(scene: Scene, trajectory: Trajectory) -> DynamicsResult:
    return load_engine("reference")(scene).inverse_dynamics(trajectory)


def legs_of(scene: Scene, trajectory: Trajectory) -> list[list[PlanarLegState]]:
    """Leg states of every sample, in floats."""
    P = planar(scene)
    motions = [one_sample(trajectory.motion, k) for k in range(len(trajectory.t))]
    pins = list(zip(P.p, P.O, strict=True))
    return [[stewart.planar_leg_kinematics(P.leg, p, O, m, math.sqrt) for p, O in pins] for m in motions]


# --- Agreement on machines without symmetry ---------------------------------------------------------------------------


@pytest.mark.parametrize("engine_name", ["analytic", *ENGINES], indirect=True)
@pytest.mark.parametrize("point", [False, True], ids=["bar", "point mass"])
@pytest.mark.parametrize("seed", range(4))
def test_agrees_with_truth_under_load_and_inclined_gravity(engine_name: str, point: bool, seed: int) -> None:
    scene = random_planar(seed, point)
    trajectory = from_scene(scene, 7)
    engines = {name: load_engine(name) for name in (engine_name, "reference")}
    results = {name: e(scene).inverse_dynamics(trajectory) for name, e in engines.items()}
    rows = agreement("id", scene, trajectory, engines, keyed(scene, trajectory, engines, results))
    assert set(rows["verdict"]) == {"pass"}, rows[["engine", "quantity", "max_rel"]]
    assert (rows["tolerance"] <= ROUNDING).all()
    assert abs(scene.gravity[0]) > 0.1


@pytest.mark.parametrize("point", [False, True], ids=["bar", "point mass"])
def test_the_load_and_every_inertia_count(point: bool) -> None:
    """Each number of a planar scene moves the forces: the agreement above is about all of them."""
    scene = random_planar(1, point)
    trajectory = from_scene(scene, 3)
    F = analytic.driving_forces(scene.parameters, trajectory.motion)

    def changed(table: str, values: dict[str, Any]) -> float:
        part = getattr(scene, table)
        other = scene.model_copy(update={table: part.model_copy(update=values)})
        return float(np.abs(truth_of(other, trajectory).F - F).max())

    leg = scene.leg
    assert scene.load is not None
    assert changed("load", {"force": (0.0, 0.0, 0.0)}) > 1e-2
    assert changed("platform", {"mass": scene.platform.mass + 0.1}) > 1e-2
    assert changed("leg", {"guide": leg.guide.model_copy(update={"J_x": leg.guide.J_x + 0.1})}) > 1e-3
    assert changed("leg", {"rod": leg.rod.model_copy(update={"J_x": leg.rod.J_x + 0.1})}) > 1e-3
    assert changed("leg", {"guide": leg.guide.model_copy(update={"com": leg.guide.com + 0.1})}) > 1e-3
    if not point:
        assert changed("load", {"moment": (0.0, 0.0, 9.0)}) > 1e-2
        assert changed("load", {"point": (0.1, 0.4, 0.0)}) > 1e-3
        assert changed("platform", {"J_z": 2.0}) > 1e-2


def _exact(vectors: Any) -> Any:
    return tuple(tuple(arb(x) for x in v) for v in vectors)


@pytest.mark.parametrize("name", ["planar3", "pointmass2"])
def test_the_same_text_runs_on_balls(name: str) -> None:
    """At 200 bits the formulas lie within 1e-40 of the truth's mechanics, which shares no line with them."""
    from stewart_crosscheck.crosscheck.newton_euler import Sample

    scene = load_scene(name)
    trajectory = from_scene(scene, 3)
    before = ctx.prec
    ctx.prec = 200
    try:
        k = 1
        keys = ("position", "quaternion", "velocity", "angular_velocity", "acceleration", "angular_acceleration")
        row = {key: getattr(trajectory, key)[k].tolist() for key in keys}
        sample = Sample(scene, row)
        want = sample.solve()
        exact = {key: [arb(x) for x in row[key]] for key in keys}
        R = sample.R
        motion = PlatformMotion(exact["position"], R, exact["velocity"], exact["angular_velocity"],
                                exact["acceleration"], exact["angular_acceleration"])  # fmt: skip
        P = planar(scene)
        leg = dataclasses.replace(P.leg, **{f.name: arb(getattr(P.leg, f.name)) for f in dataclasses.fields(P.leg)})
        P = dataclasses.replace(P, leg=leg, m_p=arb(P.m_p), p=_exact(P.p), O=_exact(P.O), g=_exact([P.g])[0])
        P = P if P.J_pz is None else dataclasses.replace(P, J_pz=arb(P.J_pz))
        one = stewart.planar_problem(P, motion, lambda x: x.sqrt(), solve_numbers)
        for i in range(scene.N):
            assert abs(one.F[i] - want["F"][i]) < 1e-40
            for mine, theirs in ((one.reactions[i].F_r, want["F_r"][i]), (one.reactions[i].F_n, want["F_n"][i])):
                assert all(abs(a - b) < 1e-40 for a, b in zip(mine, theirs[:2], strict=True))
            assert abs(one.reactions[i].M_s - want["M_s"][i][2]) < 1e-40
    finally:
        ctx.prec = before


# --- The printed equations --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["planar3", "pointmass2", "collinear"])
def test_printed_platform_equations_hold_with_certified_forces(name: str) -> None:
    """(32), (33), (35): left less right side with the truth's driving forces."""
    scene = load_scene(name)
    trajectory = from_scene(scene, 9)
    P, F = planar(scene), truth_of(scene, trajectory).F
    for k, legs in enumerate(legs_of(scene, trajectory)):
        loads = [stewart.planar_loads_printed(P.leg, leg, P.g) for leg in legs]
        motion = one_sample(trajectory.motion, k)
        rows, right = stewart.planar_platform_equations_printed(P, motion, legs, loads)
        residual = np.array(rows) @ F[k] - right
        assert np.abs(residual).max() < ROUNDING * max(np.abs(F).max(), 1.0)
        shifted = np.array(rows) @ (F[k] + 1e-6) - right
        assert name == "collinear" or np.abs(shifted).max() > 1e-8  # the equations do hold the forces


def test_printed_loads_are_the_loads() -> None:
    """(33) against what the truth's F_r says: M_in = -L x_n . F_r, F_is = F + y_n . F_r."""
    scene = load_scene("planar3")
    trajectory = from_scene(scene, 9)
    P, truth = planar(scene), truth_of(scene, trajectory)
    index = [j for j, joint in enumerate(scene.joints) if joint.cut]
    for k, legs in enumerate(legs_of(scene, trajectory)):
        for i, leg in enumerate(legs):
            x, y = truth.reactions[k, index[i], 3:5]
            loads = stewart.planar_loads_printed(P.leg, leg, P.g)
            assert loads.M_in == pytest.approx(-leg.L * (leg.c * x + leg.s * y), abs=1e-12)  # of 100 N m
            assert loads.F_is == pytest.approx(truth.F[k, i] + (leg.c * y - leg.s * x), abs=1e-12)  # of 100 N


def test_printed_loads_refuse_inclined_gravity() -> None:
    scene = random_planar(0, point=True)
    (leg, _), *_ = legs_of(scene, from_scene(scene, 1))
    with pytest.raises(ValueError, match=r"\(33\) holds for gravity along -y_r only, got g = "):
        stewart.planar_loads_printed(planar(scene).leg, leg, scene.gravity)


def test_printed_loops_close() -> None:
    """(34) and (36), whose right sides are differences of metres."""
    scene = load_scene("planar3")
    trajectory = from_scene(scene, 9)
    b, A = scene.pins[2][0], scene.hull.pins[1][0]
    for k, legs in enumerate(legs_of(scene, trajectory)):
        motion = one_sample(trajectory.motion, k)
        assert np.abs(stewart.loops_of_example_1(legs, motion, b, A)).max() < 1e-15
        assert np.abs(stewart.loops_of_example_1(legs, motion, b + 1e-9, A)).max() > 1e-10
    scene = load_scene("pointmass2")
    trajectory = from_scene(scene, 9)
    A = scene.hull.pins[1][0]
    for k, legs in enumerate(legs_of(scene, trajectory)):
        motion = one_sample(trajectory.motion, k)
        assert np.abs(stewart.loops_of_example_2(legs, motion, A)).max() < 1e-15
        assert np.abs(stewart.loops_of_example_2(legs, motion, A + 1e-9)).max() > 1e-10


# --- Special states ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine_name", ["analytic", *ENGINES], indirect=True)
def test_a_vertical_planar_leg_is_nothing_special(engine_name: str) -> None:
    """s = 0 exactly: the terms M_io/s of the spatial text would be 0/0."""
    data = load_scene("pointmass2").model_dump(by_alias=True)
    data["motion"]["position"] = ({"c0": 0.0}, {"c0": 0.8, "terms": ((0.1, 3.0, 0.4),)}, {})
    scene = Scene.model_validate(data)
    trajectory = from_scene(scene, 5)
    assert (trajectory.q["n1"] == 0.0).all()
    truth = truth_of(scene, trajectory)
    F = load_engine(engine_name)(scene).inverse_dynamics(trajectory).F
    assert np.abs(F - truth.F).max() < ROUNDING * np.abs(truth.F).max()


@pytest.fixture(scope="module")
def collinear() -> Scene:
    return load_scene("collinear")


def with_gravity(scene: Scene) -> Scene:
    return scene.model_copy(update={"gravity": (0.0, -9.81, 0.0)})


@pytest.mark.parametrize("engine_name", ["analytic", *ENGINES, "reference"], indirect=True)
def test_two_collinear_legs_determine_the_difference_of_their_forces(engine_name: str, collinear: Scene) -> None:
    """Example 3: F_1 - F_2 = (m_p + 2 m_s) x_p''; F_1 + F_2, which nothing determines, is zero."""
    trajectory = from_scene(collinear, 9)
    assert trajectory.undetermined.all()
    F = load_engine(engine_name)(collinear).inverse_dynamics(trajectory).F
    want = [stewart.difference_of_example_3(planar(collinear), x) for x in trajectory.acceleration[:, 0]]
    np.testing.assert_allclose(F[:, 0] - F[:, 1], want, rtol=0, atol=ROUNDING * np.abs(want).max())
    np.testing.assert_allclose(F.sum(axis=1), 0.0, rtol=0, atol=ROUNDING * np.abs(want).max())


def test_formulas_say_what_is_not_determined(collinear: Scene) -> None:
    trajectory = from_scene(collinear, 5)
    D = analytic.inverse_dynamics(collinear.parameters, trajectory.motion)
    assert D.undetermined.all()
    assert not analytic.inverse_dynamics(
        load_scene("pointmass2").parameters, from_scene(load_scene("pointmass2"), 5).motion
    ).undetermined.any()


def test_gravity_makes_the_collinear_motion_infeasible(collinear: Scene) -> None:
    heavy = with_gravity(collinear)
    motion = from_scene(collinear, 3).motion
    # 0 = m_p g + sum m_q g / L, from example 3 by hand
    q_s = from_scene(collinear, 3).q
    leg = collinear.leg
    m_q = [leg.guide.mass * leg.guide.com + leg.rod.mass * q_s[f"s{i}"][0] for i in (1, 2)]
    L = [q_s[f"s{i}"][0] + leg.a for i in (1, 2)]
    residual = 9.81 * (collinear.platform.mass + m_q[0] / L[0] + m_q[1] / L[1])
    with pytest.raises(analytic.Infeasible, match="sample 0: the motion is infeasible") as caught:
        analytic.inverse_dynamics(heavy.parameters, PlatformMotion(*(np.asarray(a)[:1] for a in motion)))
    assert caught.value.residual == pytest.approx(residual, rel=1e-12)
    with pytest.raises(TrajectoryError, match=r"collinear.toml: motion: t = .*: the motion is infeasible: .* by"):
        from_scene(heavy, 3)


@pytest.mark.parametrize("engine_name", [*ENGINES, "reference"], indirect=True)
def test_an_engine_finds_by_itself_that_no_forces_give_a_motion(engine_name: str, collinear: Scene) -> None:
    trajectory = from_scene(collinear, 3)
    with pytest.raises(EngineError, match="no forces give this motion: residual"):
        load_engine(engine_name)(with_gravity(collinear)).inverse_dynamics(trajectory)


def sagging(
    collinear: Scene, folder: Path, off: float = 0.0, ddx: float = 0.7, mass: float = 1.0, falling: float = 0.0
) -> tuple[Scene, Trajectory, float]:
    """Example 3 in gravity, from rest: the one acceleration that it allows, rounded; and F_1 - F_2."""
    heavy = with_gravity(collinear)
    data = heavy.model_dump(by_alias=True)
    data["platform"]["mass"] *= mass
    heavy = Scene.model_validate(data)
    still = from_scene(collinear, 1).motion
    still = still._replace(dC_p=np.zeros((1, 3)))
    P = planar(heavy)
    pins = list(zip(P.p, P.O, strict=True))
    legs = [stewart.planar_leg_kinematics(P.leg, p, O, one_sample(still, 0), math.sqrt) for p, O in pins]
    values = dict.fromkeys((*POSE, *RATES), 0.0)
    values |= {"p_x": float(still.C_p[0, 0]), "q_w": 1.0, "a_x": ddx, "v_y": falling}
    values["a_y"] = float(stewart.sag_of_example_3(P, legs)) * (1.0 + off)
    file = folder / "sag.csv"
    file.write_text(",".join(values) + "\n" + ",".join(map(repr, values.values())) + "\n")
    return heavy, from_file(heavy, file), stewart.difference_of_example_3(P, ddx)


@pytest.mark.parametrize("engine_name", ["analytic", *ENGINES, "reference"], indirect=True)
def test_with_gravity_the_collinear_pin_must_sag(engine_name: str, collinear: Scene, tmp_path: Path) -> None:
    """The sag is a rounded number, which no engine may take for an infeasible motion."""
    heavy, trajectory, difference = sagging(collinear, tmp_path)
    F = load_engine(engine_name)(heavy).inverse_dynamics(trajectory).F[0]
    assert F[0] - F[1] == pytest.approx(difference, rel=1e-12)


@pytest.mark.parametrize(
    ("off", "ddx", "mass", "falling"),
    [
        (0.0, 0.7, 1.0, 0.0),
        (2e-15, 0.7, 1.0, 0.0),
        (-2e-15, 0.7, 1.0, 0.3),  # a residual that moves has power
        (0.0, 0.0, 1.0, 0.0),
        (0.0, 0.0, 1e7, 0.0),
    ],
)
def test_what_a_trajectory_lets_in_passes_everywhere(
    off: float, ddx: float, mass: float, falling: float, collinear: Scene, tmp_path: Path
) -> None:
    """Also where nothing but weights is there, which cancel, and these are ten million times the legs'."""
    heavy, trajectory, _ = sagging(collinear, tmp_path, off, ddx, mass, falling)
    report = run(heavy, trajectory)
    assert set(report.agreement["verdict"]) == {"pass"}


@pytest.mark.parametrize("off", [1e-12, -1e-13])
def test_a_sag_that_is_off_by_more_than_rounding_is_refused(off: float, collinear: Scene, tmp_path: Path) -> None:
    with pytest.raises(
        TrajectoryError, match=r"the motion is infeasible: .* missed by \S+ \(N or N m\), expected at most"
    ):
        sagging(collinear, tmp_path, off)


def test_the_limit_of_the_sag_is_that_of_its_own_sample(collinear: Scene, tmp_path: Path) -> None:
    """Another sample of 1e9 newtons must not let in what is infeasible."""
    heavy, trajectory, _ = sagging(collinear, tmp_path)
    motion = PlatformMotion(*(np.repeat(a, 2, axis=0) for a in trajectory.motion))
    motion.ddC_p[:] *= [[1e8, 1.0, 1.0], [1.0, 1.0 + 1e-9, 1.0]]
    with pytest.raises(analytic.Infeasible, match="sample 1: the motion is infeasible") as caught:
        analytic.inverse_dynamics(heavy.parameters, motion)
    assert caught.value.limit < 1e-10


def test_nearly_collinear_legs_are_refused(collinear: Scene) -> None:
    data = collinear.model_dump(by_alias=True)
    data["motion"]["position"] = (*data["motion"]["position"][:1], {"c0": 1e-13}, {})
    with pytest.raises(TrajectoryError, match=r"singular pose: .* condition of the platform.* above 1e\+12"):
        from_scene(Scene.model_validate(data), 3)
    motion = from_scene(collinear, 1).motion
    with pytest.raises(SingularPose):
        analytic.inverse_dynamics(collinear.parameters, motion._replace(C_p=motion.C_p + np.array([0.0, 1e-13, 0.0])))


def test_a_height_whose_square_underflows_is_no_exact_zero(collinear: Scene) -> None:
    data = collinear.model_dump(by_alias=True)
    data["motion"]["position"] = (*data["motion"]["position"][:1], {"c0": 1e-200}, {})
    with pytest.raises(TrajectoryError, match="singular pose"):
        from_scene(Scene.model_validate(data), 3)


def test_a_bar_and_its_legs_in_one_line_are_refused() -> None:
    """Forces along y_r and moments both vanish: two combinations would be free."""
    data = load_scene("planar3").model_dump(by_alias=True)
    data["gravity"] = (0.0, 0.0, 0.0)
    data["hull"]["pins"] = ((0.0, 0.0, 0.0), (-0.2, 0.0, 0.0), (3.0, 0.0, 0.0))
    data["motion"]["position"] = ({"c0": 1.3, "terms": ((0.1, 3.0, 0.0),)}, {}, {})
    data["motion"]["orientation"]["components"] = ({}, {}, {})
    with pytest.raises(TrajectoryError, match="singular pose"):
        from_scene(Scene.model_validate(data), 3)


def test_a_singular_run_says_what_it_compares(collinear: Scene) -> None:
    info = run(collinear, from_scene(collinear, 3), ["analytic"]).info
    assert info["trajectory"]["undetermined"] == (
        "singular at 3 of 3 samples, rank 5 of 6: the motion determines F_1 - F_2, not F_1 + F_2;"
        " compared are the shortest driving forces of that motion"
    )
    assert (
        run(load_scene("planar3"), from_scene(load_scene("planar3"), 3), ["analytic"]).info["trajectory"][
            "undetermined"
        ]
        == ""
    )


HEIGHTS = (-0.4, 0.1, 0.5)


@pytest.fixture(scope="module")
def parallel() -> Scene:
    """An upright bar that three level legs move across itself: nothing pushes along it."""
    data = load_scene("planar3").model_dump(by_alias=True)
    data["gravity"] = (0.0, 0.0, 0.0)
    data["platform"]["pins"] = data["hull"]["pins"] = tuple((0.0, y, 0.0) for y in HEIGHTS)
    data["motion"]["position"] = ({"c0": 1.3, "terms": ((0.1, 3.0, 0.0),)}, {}, {})
    data["motion"]["orientation"]["components"] = ({}, {}, {})
    return Scene.model_validate(data)


@pytest.mark.parametrize("engine_name", ["analytic", *ENGINES, "reference"], indirect=True)
def test_three_parallel_legs_have_the_shortest_forces(engine_name: str, parallel: Scene) -> None:
    """Their sum and their moment accelerate bar and rods; the shortest such forces are those of the pseudoinverse."""
    trajectory = from_scene(parallel, 9)
    assert trajectory.undetermined.all()
    F = load_engine(engine_name)(parallel).inverse_dynamics(trajectory).F
    m_p, m_s, x = parallel.platform.mass, parallel.leg.rod.mass, trajectory.acceleration[:, 0]
    held = np.array([m_p + 3 * m_s, m_s * sum(HEIGHTS)])
    want = np.outer(x, np.linalg.pinv(np.array([(1.0, 1.0, 1.0), HEIGHTS])) @ held)
    np.testing.assert_allclose(F, want, rtol=0, atol=ROUNDING * np.abs(want).max())


def test_a_singular_run_of_a_bar_says_what_it_compares(parallel: Scene) -> None:
    report = run(parallel, from_scene(parallel, 3), ["analytic"])
    assert report.info["trajectory"]["undetermined"] == (
        "singular at 3 of 3 samples, rank 8 of 9: the motion determines two combinations of the three driving forces,"
        " not a third one; compared are the shortest driving forces of that motion"
    )
    assert report.status == 0


@pytest.mark.parametrize(("name", "N", "source"), [("planar3", 2, r"\(32\)"), ("pointmass2", 1, r"\(35\)")])
def test_another_number_of_legs_is_refused_with_what_is_determined(name: str, N: int, source: str) -> None:
    scene = load_scene(name)
    P, motion = planar(scene), from_scene(scene, 1).motion
    few = dataclasses.replace(P, p=P.p[:N], O=P.O[:N])
    with pytest.raises(
        NotDeterminate, match=rf"N = {N} legs: {source} are {N + 1} equations .* overdetermined: 1"
    ) as e:
        analytic.driving_forces(few, motion)
    assert len(e.value.determined[1]) == N


# --- Tables -----------------------------------------------------------------------------------------------------------


def test_planar_samples_list_the_components_that_exist() -> None:
    scene = load_scene("planar3")
    trajectory = from_scene(scene, 2)
    results: Any = {("analytic", "closed_form"): load_engine("analytic")(scene).inverse_dynamics(trajectory)}
    (table,) = samples(scene, trajectory, results)
    found = {q: "".join(rows["component"].unique()) for q, rows in table.groupby("quantity")}
    forces, moments = ("F_r", "F_s", "F_n", "F_hull"), ("M_s", "M_n", "M_hull")
    assert found == dict.fromkeys(forces, "xy") | dict.fromkeys(moments, "z") | dict.fromkeys(
        ("F", "L", "dL", "power"), "-"
    )
    assert sorted(table[table["quantity"] == "F"]["leg"].unique()) == [1, 2, 3]
    assert list(table[table["quantity"] == "F_hull"]["leg"].unique()) == [0]


# --- What a planar scene may not hold ---------------------------------------------------------------------------------


def refusal(name: str, change: dict[str, Any]) -> str:
    """Message for a built-in scene with some values changed; a value `...` removes the key."""
    data = load_scene(name).model_dump(by_alias=True, exclude_none=True)
    for path, value in change.items():
        *tables, key = path.split(".")
        table = data
        for part in tables:
            table = table.setdefault(part, {})
        if value is ...:
            del table[key]
        else:
            table[key] = value
    with pytest.raises((SceneError, ValueError)) as caught:
        Scene.model_validate(data)
    return str(caught.value)


ZERO = {"c0": 0.0}
TURN = {"kind": "cardan_xyz", "components": (ZERO, {"c0": 0.1}, ZERO)}

REFUSED = [
    ("planar3", {"leg.base": {"mass": 1.0, "J_z": 0.1}}, "leg.base: got a value, expected no such key"),
    ("planar3", {"platform.inertia": ((1, 0, 0), (0, 1, 0), (0, 0, 1.0))}, "platform.inertia"),
    ("planar3", {"platform.pins": ...}, "platform.pins: got nothing, expected this key: a planar platform with `J_z`"),
    ("planar3", {"motion.orientation": ...}, "motion.orientation: got nothing, expected this key"),
    ("planar3", {"platform.J_z": 0.0}, "platform.J_z"),
    ("planar3", {"gravity": (0.0, -9.81, 0.1)}, "gravity[2]: got 0.1, expected 0: a planar scene moves in x_r y_r"),
    ("planar3", {"hull.pins": ((0.0, 0.0, 0.0), (1.0, 0.0, 0.2), (1.0, 0.0, 0.0))}, "hull.pins[1][2]: got 0.2"),
    ("planar3", {"platform.pins": ((0.1, 0.0, 0.3),) * 3}, "platform.pins[0][2]: got 0.3"),
    ("planar3", {"motion.position": (ZERO, ZERO, {"c0": 1.0})}, "motion.position[2]: got a component that is not zero"),
    ("planar3", {"motion.orientation": TURN}, "motion.orientation.components[1]: got a component that is not zero"),
    ("planar3", {"load": {"force": (0.0, 0.0, 1.0)}}, "load.force[2]: got 1.0"),
    ("planar3", {"load": {"moment": (1.0, 0.0, 0.0)}}, "load.moment[0]: got 1.0"),
    ("planar3", {"load": {"point": (0.0, 0.0, 2.0)}}, "load.point[2]: got 2.0"),
    ("planar3", {"initial": {"position": (0.0, 0.0, 0.1), "orientation": {"kind": "cardan_xyz", "angles": (0.0,) * 3}}},
     "initial.position[2]: got 0.1"),
    ("pointmass2", {"platform.pins": ((0.1, 0.0, 0.0),) * 2}, "platform.pins: got a value, expected no such key"),
    ("pointmass2", {"motion.orientation": TURN}, "motion.orientation: got a value, expected no such key: a point mass"),
    ("pointmass2", {"load": {"moment": (0.0, 0.0, 1.0)}}, "load.moment[2]: got 1.0, expected 0: a point mass"),
    ("pointmass2", {"load": {"point": (0.1, 0.0, 0.0)}}, "load.point[0]: got 0.1"),
    ("pointmass2", {"initial": {"position": (0.5, 0.9, 0.0), "angular_velocity": (0.0, 0.0, 1.0)}},
     "initial.angular_velocity[2]: got 1.0"),
    ("hexapod", {"platform.J_z": 1.0}, "platform.J_z: got a value, expected no such key: a spatial scene"),
    ("hexapod", {"platform.inertia": ...}, "platform.inertia: got nothing, expected this key: a spatial scene"),
    ("hexapod", {"platform.pins": ...}, "platform.pins: got nothing, expected this key: a spatial scene"),
    ("hexapod", {"motion.orientation": ...}, "motion.orientation: got nothing, expected this key"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "change", "message"), REFUSED, ids=[f"{n}-{next(iter(c))}" for n, c, _ in REFUSED])
def test_a_scene_with_what_its_topology_cannot_have_is_refused(name: str, change: dict, message: str) -> None:
    assert message in refusal(name, change)


def test_a_planar_leg_may_say_its_inertia_about_the_long_axis() -> None:
    """It does not matter there, and need not be given."""
    data = load_scene("planar3").model_dump(by_alias=True, exclude_none=True)
    data["leg"]["guide"]["J_y"], data["leg"]["rod"]["J_z"] = 0.01, 0.02
    scene = Scene.model_validate(data)
    plain = load_scene("planar3")
    F = [load_engine("reference")(s).inverse_dynamics(from_scene(plain, 3)).F for s in (scene, plain)]
    np.testing.assert_array_equal(F[0], F[1])


# --- What a planar trajectory may not hold ----------------------------------------------------------------------------


def trajectory_refusal(name: str, tmp_path: Path, **change: float) -> str:
    scene = load_scene(name)
    t = from_scene(scene, 1)
    row = [t.t, *t.position.T, *t.quaternion.T, *t.velocity.T, *t.angular_velocity.T, *t.acceleration.T]
    values = dict(zip((*POSE, *RATES), (float(x[0]) for x in (*row, *t.angular_acceleration.T)), strict=True)) | change
    file = tmp_path / "motion.csv"
    file.write_text(",".join(values) + "\n" + ",".join(map(repr, values.values())) + "\n")
    with pytest.raises(TrajectoryError) as caught:
        from_file(scene, file)
    return str(caught.value)


@pytest.mark.parametrize("column", ["p_z", "v_z", "a_z", "w_x", "w_y", "alpha_x", "alpha_y"])
def test_a_motion_out_of_the_plane_is_refused(column: str, tmp_path: Path) -> None:
    message = trajectory_refusal("planar3", tmp_path, **{column: 1e-9})
    assert column.split("_")[0] in message or column.startswith("alpha")
    assert "sample 0" in message
    assert "got a motion, expected zeros: a planar platform stays in x_r y_r" in message


def test_a_platform_tilted_out_of_the_plane_is_refused(tmp_path: Path) -> None:
    assert "q_x, q_y: got a motion" in trajectory_refusal("planar3", tmp_path, q_x=1e-9)


@pytest.mark.parametrize("column", ["q_z", "w_z", "alpha_z"])
def test_a_point_mass_that_turns_is_refused(column: str, tmp_path: Path) -> None:
    message = trajectory_refusal("pointmass2", tmp_path, **{column: 1e-9})
    assert "got a motion, expected zeros: a point mass does not turn" in message


def test_a_planar_text_is_read(tmp_path: Path) -> None:
    """The smallest planar scene file: nothing that it does not need."""
    text = """
schema = 1
name = "two"
topology = "planar"
[leg]
a = 0.2
guide = { mass = 1.0, com = 0.1, J_x = 0.05 }
rod = { mass = 1.0, J_x = 0.03 }
[platform]
mass = 2.0
[hull]
pins = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
"""
    scene = parse_scene(text, "two.toml")
    assert (scene.freedom, scene.nv, scene.na, scene.nc) == ("point", 6, 2, 4)
    assert scene.gravity == (0.0, -9.81, 0.0)


# --- The second problem -----------------------------------------------------------------------------------------------

MOVING = ["planar3", "pointmass2", "collinear", "random bar", "random point"]


def moving(name: str) -> Scene:
    return random_planar(3, name.endswith("point")) if name.startswith("random") else load_scene(name)


@pytest.mark.parametrize("form", ["compliance", "reduced", "paper"])
@pytest.mark.parametrize("name", MOVING)
def test_certified_forces_give_the_accelerations_back(form: str, name: str, conditions: list[np.ndarray]) -> None:
    """Collinear legs too: what is singular for the forces is regular for the motion."""
    scene = moving(name)
    trajectory = from_scene(scene, 9)
    found = analytic.forward_dynamics(scene.parameters, trajectory.motion, truth_of(scene, trajectory).F, form)
    scale = np.abs(trajectory.acceleration).max()
    for mine, want in ((found.ddC_p, trajectory.acceleration), (found.dw_p, trajectory.angular_acceleration)):
        np.testing.assert_allclose(mine, want, rtol=0, atol=ROUNDING * max(scale, 1.0))
    assert conditions[0].max() < 40
    for backend in ("numpy", "float", "compiled"):
        other = analytic.forward_dynamics(
            scene.parameters, trajectory.motion, truth_of(scene, trajectory).F, backend=backend
        )
        np.testing.assert_allclose(other.ddC_p, found.ddC_p, rtol=0, atol=ROUNDING * max(scale, 1.0))
        np.testing.assert_allclose(other.dw_p, found.dw_p, rtol=0, atol=ROUNDING * max(scale, 1.0))


@pytest.mark.parametrize(
    ("function", "change"),
    [("planar_loads", {"F_is": -1.0}), ("planar_loads", {"M_in": -1.0}), ("planar_screw", None)],
)
def test_a_wrong_term_of_the_second_problem_shows(
    function: str, change: dict[str, float] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = getattr(stewart, function)

    def broken(*args: Any) -> Any:
        out = whole(*args)
        if change is None:
            return (*out[:2], -out[2])
        return out._replace(**{name: factor * getattr(out, name) for name, factor in change.items()})

    scene = load_scene("planar3")
    trajectory = from_scene(scene, 5)
    F = truth_of(scene, trajectory).F
    monkeypatch.setattr(stewart, function, broken)
    for form in ("reduced", "paper"):
        found = analytic.forward_dynamics(scene.parameters, trajectory.motion, F, form)
        assert np.abs(found.dw_p - trajectory.angular_acceleration).max() > 1e-3


@pytest.mark.parametrize("name", ["planar3", "pointmass2"])
def test_a_planar_simulation_follows_the_motion_and_keeps_the_energy(name: str) -> None:
    """Round-off of 1e-15 per step grows by a few hundred in 1 s; the energies are ten times the work."""
    scene = load_scene(name)
    t = np.linspace(0.0, 1.0, 6)
    want = along(scene, t)
    position, q, v, w = (x[0].tolist() for x in (want.position, want.quaternion, want.velocity, want.angular_velocity))
    start = analytic.State(position, q, v, w)
    P = scene.parameters
    s = analytic.simulate(P, start, lambda now: analytic.driving_forces(P, along(scene, np.array([now])).motion)[0], t)
    assert np.abs(s.position - want.position).max() < 1e-11
    assert np.abs(s.quaternion - want.quaternion).max() < 1e-11
    assert np.abs(analytic.energy_defect(P, s)).max() < 1e-12 * np.ptp(s.work)
    assert np.ptp(s.work) > 1.0


def test_a_planar_leg_of_no_length_is_refused() -> None:
    scene = load_scene("pointmass2")
    motion = from_scene(scene, 1).motion._replace(C_p=np.zeros((1, 3)))
    with pytest.raises(SingularPose, match="sample 0, leg 1: length = 0"):
        analytic.forward_dynamics(scene.parameters, motion, np.ones((1, 2)))
