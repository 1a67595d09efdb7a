"""The built-in scenes: each in every engine, with no more bodies, joints and rows than it needs."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from conftest import ENGINES, keyed
from scipy.spatial.transform import Rotation

from stewart_crosscheck import analytic
from stewart_crosscheck.analytic import PlatformMotion
from stewart_crosscheck.crosscheck.compare import agreement
from stewart_crosscheck.crosscheck.engine import load_engine
from stewart_crosscheck.crosscheck.trajectory import from_scene
from stewart_crosscheck.models import Scene, load_scene, scene_names, write_models
from stewart_crosscheck.models.mjcf import FLOOR

only_mujoco = pytest.mark.parametrize("engine_name", ["mujoco"], indirect=True)
only_dart = pytest.mark.parametrize("engine_name", ["dart"], indirect=True)

# bodies, velocities, actuators, closure equations
SIZES = {
    "hexapod": (19, 24, 6, 18),
    "hanging": (19, 24, 6, 18),
    "tsai2000": (13, 24, 6, 18),
    "planar3": (7, 9, 3, 6),
    "pointmass2": (5, 6, 2, 4),
    "collinear": (5, 6, 2, 4),
}

# links without mass, which URDF wants between two joints: one per universal joint, one below a point mass
MASSLESS = {"hexapod": 0, "hanging": 0, "tsai2000": 6, "planar3": 0, "pointmass2": 1, "collinear": 1}


def test_every_scene_is_counted() -> None:
    assert set(SIZES) == set(scene_names())
    for name, size in SIZES.items():
        scene = load_scene(name)
        assert (len(scene.bodies), scene.nv, scene.na, scene.nc) == size
        assert scene.nv == scene.na + scene.nc


@pytest.mark.parametrize("name", SIZES)
def test_an_engine_holds_the_bodies_velocities_rows_and_mass_of_the_scene(engine_name: str, name: str) -> None:
    scene = load_scene(name)
    facts = load_engine(engine_name)(scene).inverse_dynamics(from_scene(scene, 1)).model
    assert facts is not None
    bodies, nv, _, nc = SIZES[name]
    planar_rows = scene.N if engine_name == "mujoco" and scene.topology == "planar" else 0
    massless = 0 if engine_name == "mujoco" else MASSLESS[name]
    assert (facts.bodies, facts.massless, facts.velocities, facts.rows) == (bodies, massless, nv, nc + planar_rows)
    assert facts.mass == pytest.approx(sum(body.mass for body in scene.bodies), rel=1e-15)  # a sum of twenty numbers
    text = "; ".join(facts.floors)
    assert ("links of zero mass" in text) == bool(massless)
    assert (f"loop rows along z_r, zero and left out: {scene.N} of {3 * scene.N}" in text) == bool(planar_rows)
    flat = {"tsai2000": 12, "pointmass2": 1, "collinear": 1}.get(name, 0) if engine_name == "mujoco" else 0
    assert (f"in place of a zero moment of inertia, bodies: {flat}" in text) == bool(flat)
    assert len(facts.floors) == bool(massless) + bool(planar_rows) + bool(flat)


@pytest.mark.parametrize("engine_name", ["analytic", *ENGINES], indirect=True)
@pytest.mark.parametrize("name", SIZES)
def test_every_engine_agrees_with_truth(engine_name: str, name: str) -> None:
    """Forces, moments, what the hull feels, loops, balance: everything a run compares, at its own tolerances."""
    scene = load_scene(name)
    trajectory = from_scene(scene, 9)
    engines = {e: load_engine(e) for e in (engine_name, "reference")}
    results = {e: engine(scene).inverse_dynamics(trajectory) for e, engine in engines.items()}
    rows = agreement("id", scene, trajectory, engines, keyed(scene, trajectory, engines, results))
    assert set(rows["verdict"]) == {"pass"}, rows[rows["verdict"] != "pass"][["engine", "quantity", "max_rel"]]
    floor = 1e-14 if (engine_name, name) == ("mujoco", "tsai2000") else 0.0
    assert (rows["tolerance"] <= 1e-13 + floor).all()  # no built-in scene is a hard one


# --- What a format cannot do without, measured ------------------------------------------------------------------------


@only_mujoco
def test_the_inertia_that_mujoco_wants_changes_nothing_that_counts(engine_name: str) -> None:
    """The error of the driving forces is proportional to the floor; at 1e-15 kg m^2 it is far below rounding."""
    scene = load_scene("tsai2000")
    trajectory = from_scene(scene, 9)
    truth = load_engine("reference")(scene).inverse_dynamics(trajectory).F
    errors = []
    floors = [1e-3, 1e-5, 1e-7]
    for floor in floors:
        models = {k: text.replace(f" {FLOOR!r} ", f" {floor!r} ") for k, text in write_models(scene).items()}
        F = load_engine(engine_name)(scene, models).inverse_dynamics(trajectory).F
        errors.append(np.abs(F - truth).max() / np.abs(truth).max())
    slopes = np.diff(np.log(errors)) / np.diff(np.log(floors))
    np.testing.assert_allclose(slopes, 1.0, rtol=0, atol=0.02)  # the law has a second term, of the order of the floor
    assert errors[-1] / floors[-1] * FLOOR < 1e-14


@only_mujoco
def test_an_inertia_below_mujocos_floor_is_raised_to_it(engine_name: str) -> None:
    data = load_scene("tsai2000").model_dump(by_alias=True, exclude_none=True)
    data["leg"]["guide"]["J_y"] = 1e-16
    scene = Scene.model_validate(data)
    facts = load_engine(engine_name)(scene).inverse_dynamics(from_scene(scene, 1)).model
    assert facts is not None
    assert facts.floors == (f"{FLOOR:g} kg m^2 in place of a zero moment of inertia, bodies: 12",)


@pytest.mark.parametrize("offset", [9e-7, -1e-9])
def test_offsets_below_a_micrometre_are_no_zeros(engine_name: str, offset: float) -> None:
    """MuJoCo lets a site or a centre of mass coincide with its body's frame there, unless told: 1e-4 N, 1e-6 m."""
    data = load_scene("hexapod").model_dump(by_alias=True, exclude_none=True)
    data["leg"]["a"] = data["leg"]["guide"]["com"] = offset
    scene = Scene.model_validate(data)
    trajectory = from_scene(scene, 3)
    engines = {e: load_engine(e) for e in (engine_name, "reference")}
    results = {e: engine(scene).inverse_dynamics(trajectory) for e, engine in engines.items()}
    rows = agreement("id", scene, trajectory, engines, keyed(scene, trajectory, engines, results))
    assert set(rows["verdict"]) == {"pass"}, rows[rows["verdict"] != "pass"][["engine", "quantity", "max_rel"]]


@only_dart
def test_a_link_that_does_not_say_zero_would_weigh_a_kilogram_in_dart(engine_name: str) -> None:
    """Why the massless links carry an explicit zero: the same URDF without it is another machine."""
    scene = load_scene("pointmass2")
    models = write_models(scene)
    urdf = models["pointmass2.urdf"]
    start = urdf.index('<link name="cart">')
    end = urdf.index("</link>", start) + len("</link>")
    models["pointmass2.urdf"] = urdf[:start] + '<link name="cart" />' + urdf[end:]
    trajectory = from_scene(scene, 1)
    facts = load_engine(engine_name)(scene, models).inverse_dynamics(trajectory).model
    assert facts is not None
    assert facts.mass == pytest.approx(sum(body.mass for body in scene.bodies) + 1.0, rel=1e-12)


# --- What each scene is there for -------------------------------------------------------------------------------------


def _tsai(motion: int) -> Scene:
    """Tsai's manipulator in translation (1, the scene's own motion) or in yaw (2)."""
    scene = load_scene("tsai2000")
    if motion == 1:
        return scene
    data = scene.model_dump(by_alias=True)
    data["motion"]["position"] = ({"c0": -1.5}, {"c0": 1.0}, {})
    yaw = {"terms": ((np.pi / 6, 3.0, 0.0),)}
    data["motion"]["orientation"] = {"kind": "cardan_xyz", "components": ({}, yaw, {})}
    return Scene.model_validate(data)


@pytest.mark.parametrize("engine_name", ["analytic", *ENGINES], indirect=True)
@pytest.mark.parametrize("motion", [1, 2])
def test_forces_of_tsais_manipulator(engine_name: str, motion: int) -> None:
    """Forces from a virtual-power evaluation by others: legs that do not spin, and need no inertia about their axis."""
    with (Path(__file__).parent / "data" / "tsai2000.csv").open() as file:
        rows = [[float(x) for x in row[1:]] for row in list(csv.reader(file))[1:] if row[0] == str(motion)]
    stored = np.array(rows)
    scene = _tsai(motion)
    trajectory = from_scene(scene, len(stored))
    np.testing.assert_allclose(trajectory.t, stored[:, 0], rtol=0, atol=1e-15)
    F = load_engine(engine_name)(scene).inverse_dynamics(trajectory).F
    # The bar for stored numbers of 17 digits; measured 2e-15 of the largest force.
    assert np.abs(F - stored[:, 1:]).max() < 1e-12 * np.abs(stored[:, 1:]).max()


def _stiffness(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Gradient and eigenvalues of the Hessian of the potential at rest, driving forces held: [N, N m], [N/m, N m]."""
    scene = load_scene(name)
    assert scene.motion is not None
    assert scene.motion.orientation is not None
    C = np.array([c.c0 for c in scene.motion.position])
    R = Rotation.from_euler("XYZ", [c.c0 for c in scene.motion.orientation.components]).as_matrix()
    at_rest = PlatformMotion(C[None], R[None], *np.zeros((4, 1, 3)))
    F = analytic.driving_forces(scene.parameters, at_rest)[0]
    g, leg = np.array(scene.gravity), scene.leg

    def potential(x: np.ndarray) -> float:
        """Weights of platform, guides, rods, and the constant forces that do work along the legs."""
        V = -scene.platform.mass * g @ (C + x[:3])
        turned = Rotation.from_rotvec(x[3:]).as_matrix() @ R
        for p, O, F_i in zip(np.array(scene.pins), np.array(scene.hull.pins), F, strict=True):
            l = C + x[:3] + turned @ p - O
            L = np.linalg.norm(l)
            V -= (leg.guide.mass * leg.guide.com + leg.rod.mass * (L - leg.a)) * (g @ l) / L + F_i * L
        return float(V)

    step = 1e-3 * np.eye(6)
    gradient = np.array([(potential(e) - potential(-e)) / 2e-3 for e in step])
    hessian = [[potential(a + b) - potential(a - b) - potential(b - a) + potential(-a - b) for a in step] for b in step]
    return gradient, np.linalg.eigvalsh(np.array(hessian) / 4e-6)


def test_the_hanging_hexapod_is_stable_when_its_forces_are_given() -> None:
    """An energy of some 500 J in steps of 1e-3: rounding 1e-13 / 4e-6 and a step error of 1e-6 of the value."""
    gradient, stiffness = _stiffness("hanging")
    assert np.abs(gradient).max() < 1e-3  # N: it is at rest there; the weight alone would be 43.6 g = 428 N
    assert stiffness.min() > 50.0


def test_the_standing_hexapod_is_not() -> None:
    gradient, stiffness = _stiffness("hexapod")
    assert np.abs(gradient).max() < 1e-3
    assert stiffness.max() < -20.0
