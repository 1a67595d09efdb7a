"""Certified forward dynamics, thin legs, and how far half-ulp changes of the inputs move an exact answer."""

from __future__ import annotations

import math

import flint
import numpy as np
import pytest
from conftest import parameters
from flint import arb

from stewart_crosscheck import analytic
from stewart_crosscheck.crosscheck import certainty
from stewart_crosscheck.crosscheck.certainty import certain_forward, certain_inverse, condition_of_forces, moved
from stewart_crosscheck.crosscheck.engines import reference_
from stewart_crosscheck.crosscheck.engines.reference_ import NotCertified, certified, certified_forward
from stewart_crosscheck.crosscheck.hard import Point, Row, load_family
from stewart_crosscheck.crosscheck.newton_euler import Sample
from stewart_crosscheck.crosscheck.trajectory import Trajectory, from_scene
from stewart_crosscheck.models import Scene, load_scene


def row_of(trajectory: Trajectory, k: int) -> Row:
    return Row(*(tuple(getattr(trajectory, name)[k].tolist()) for name in Row._fields))


def thin(scene: Scene) -> Scene:
    """Without base and without inertia about the long axes."""
    data = scene.model_dump(exclude_none=True, by_alias=True)
    del data["leg"]["base"]
    data["leg"]["guide"]["J_y"] = data["leg"]["rod"]["J_z"] = 0.0
    return Scene.model_validate(data)


@pytest.fixture(scope="module")
def point(hexapod: Scene) -> Point:
    return Point(hexapod, row_of(from_scene(hexapod, 7), 3))


@pytest.mark.parametrize("name", ["hexapod", "planar3", "pointmass2", "tsai2000"])
def test_forces_of_a_motion_give_its_accelerations_back(name: str) -> None:
    """Rounding of the forces to float64 moves them; exact forces would leave a difference below 1e-20."""
    scene = load_scene(name)
    row = row_of(from_scene(scene, 7), 3)
    exact = certified(scene, row._asdict())
    F = [float(f) for f in exact["F"]]
    found, matrix = certified_forward(scene, row._asdict(), F)
    got = np.array([[float(x) for x in found[q][0]] for q in ("a", "alpha")])
    want = np.array([row.acceleration, row.angular_acceleration])
    with flint.ctx.workprec(200):  # what the rounding of F moves, by the same matrix
        left = Sample(scene, row._asdict()).left_over([arb(f) for f in F])
        step = [float(x[0]) for x in matrix.solve(flint.arb_mat([[-x] for x in left])).tolist()]
    columns = {6: (0, 1, 2, 3, 4, 5), 3: (0, 1, 5), 2: (0, 1)}[len(step)]
    difference = (got - want).ravel()
    assert 0 < np.abs(difference).max() < 1e-12
    np.testing.assert_allclose(difference[list(columns)], step, rtol=0, atol=2e-15 * np.abs(want).max())
    heavier = scene.model_copy(
        update={"platform": scene.platform.model_copy(update={"mass": scene.platform.mass * 1.001})}
    )
    other, _ = certified_forward(heavier, row._asdict(), F)
    assert np.abs([float(x) for x in other["a"][0]] - want[0]).max() > 1e-4


def test_certified_accelerations_are_those_of_the_formulas(point: Point) -> None:
    """In a pose of yaw 90 degrees, which may be singular: forces need not follow from the motion."""
    turned = point.row._replace(quaternion=(math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0))
    found, _ = certified_forward(point.scene, turned._asdict(), point.forces)
    p, _, v, w, a, dw = (np.array([x]) for x in turned)
    R = np.array([[[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]])
    motion = analytic.PlatformMotion(p, R, v, w, a, dw)
    got = analytic.forward_dynamics(parameters(point.scene), motion, np.array([point.forces]))
    want = [[float(x) for x in found[name][0]] for name in ("a", "alpha")]
    np.testing.assert_allclose([got.ddC_p[0], got.dw_p[0]], want, rtol=1e-13)


def test_accelerations_without_mass_are_not_certified(point: Point, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Sample, "left_over", lambda self, F: [arb(1)] * 6)  # no acceleration changes anything
    with pytest.raises(NotCertified, match="no accelerations"):
        certified_forward(point.scene, point.row._asdict(), point.forces)


class ByAngles(Sample):
    """Takes every leg for one that turns about y_r."""

    thin = property(lambda self: False, lambda self, value: None)


def test_a_thin_leg_needs_no_base_angle(hexapod: Scene, point: Point, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both descriptions give the same balls where both hold; the one without angles also holds for a vertical leg."""
    scene = thin(hexapod)
    x, _, z = scene.pins[0]
    hull = scene.hull.model_copy(update={"pins": ((x, 0.0, z), *scene.hull.pins[1:])})
    upright = scene.model_copy(update={"hull": hull}), Row((0.0, 0.94, 0.0), (1.0, 0.0, 0.0, 0.0), *point.row[2:])
    free = certified(scene, point.row._asdict())
    assert max(abs(float(f)) for f in certified(upright[0], upright[1]._asdict())["F"]) < 1e4
    monkeypatch.setattr(reference_, "Sample", ByAngles)
    angles = certified(scene, point.row._asdict())
    for name in (*scene.quantities, "F_hull", "M_hull"):
        for one, other in zip(free[name], angles[name], strict=True):
            pairs = zip(one, other, strict=True) if isinstance(one, tuple) else [(one, other)]
            assert all(abs(float(a - b)) < 1e-30 for a, b in pairs), name
    with pytest.raises(NotCertified):
        certified(upright[0], upright[1]._asdict())


def test_every_number_is_moved_once_and_by_one_ulp() -> None:
    assert list(moved((1.0, 0.0, (-2.0,)))) == [(1.0 + 2**-52, 0.0, (-2.0,)), (1.0, 0.0, (-2.0 + 2**-52,))]
    scene = load_scene("pointmass2")
    texts = {str(s.model_dump()) for s in moved(scene)}
    leg, hull = 6, 1  # a, masses, com, J_x of guide and rod; one pin is not the origin
    assert len(texts) == len(list(moved(scene))) == 1 + leg + 1 + hull
    assert str(scene.model_dump()) not in texts


def test_sensitivity_is_what_random_half_ulps_do_at_most(point: Point, monkeypatch: pytest.MonkeyPatch) -> None:
    """All inputs moved at once, each by half an ulp up or down: never more than the bound, often a good part of it."""
    truth = certain_inverse(point)
    rng = np.random.default_rng(5)
    largest = 0.0
    numbers = list(moved(point))
    with flint.ctx.workprec(300):
        exact = Sample(point.scene, point.row._asdict()).solve()["F"]
        changes = np.array(
            [[float(b - a) for a, b in zip(exact, Sample(p.scene, p.row._asdict()).solve()["F"], strict=True)]
             for p in numbers]
        )  # fmt: skip
    for _ in range(200):
        signs = rng.choice([-0.5, 0.5], len(numbers))
        largest = max(largest, float(np.abs(signs @ changes).max()))
    assert 0.2 * truth.sensitivity["F"] < largest <= truth.sensitivity["F"] * (1 + 1e-9)


def test_sensitivity_grows_with_the_condition(hexapod: Scene) -> None:
    """Hull pins that come together in pairs, and platform pins with them: forces lose what the condition says."""
    found = []
    for gap in (1e-2, 1e-5):
        pins = [list(pin) for pin in hexapod.hull.pins]
        own = [list(pin) for pin in hexapod.pins]
        pins[1], own[1] = [x + gap for x in pins[0]], [x + gap for x in own[0]]
        own[1][1] -= 0.5 * gap
        data = hexapod.model_dump(exclude_none=True, by_alias=True)
        data["hull"]["pins"], data["platform"]["pins"] = pins, own
        scene = Scene.model_validate(data)
        truth = certain_inverse(Point(scene, row_of(from_scene(hexapod, 7), 3)))
        found.append(truth.sensitivity["F"] / np.abs(truth.result.F).max() / truth.condition)
    assert 0.1 < found[1] / found[0] < 10


def test_forward_sensitivity_has_the_forces_too(point: Point, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = certain_forward(point).sensitivity["a"]
    with flint.ctx.workprec(certainty.BITS):
        larger = list(moved(point.forces, certainty.hardly_larger))
    monkeypatch.setattr(certainty, "moved", lambda x, by: larger if x == point.forces else [])
    only_forces = certain_forward(point).sensitivity["a"]
    assert 0.01 * whole < only_forces < whole


def test_condition_in_a_singular_pose(hexapod: Scene, point: Point) -> None:
    data = hexapod.model_dump(exclude_none=True, by_alias=True)
    for part in ("hull", "platform"):
        first, _, *others = data[part]["pins"]
        data[part]["pins"] = [first, first, *others]
    double = point._replace(scene=Scene.model_validate(data))
    assert condition_of_forces(double) > 1e15
    with pytest.raises(NotCertified):
        certain_inverse(double)
    assert np.isfinite(np.asarray(certain_forward(double).result.platform)).all()


def test_a_leg_too_short_for_joint_coordinates_has_certain_forces() -> None:
    """Its joints' coordinates lose their digits, and engines refuse it; forces do not, and truth is no engine."""
    (case,) = (case for case in load_family("motion") if case.name == "motion_short")
    short = case.at(1e-5)
    assert math.isnan(condition_of_forces(short))
    sure = certain_inverse(short)
    assert np.isfinite(sure.result.F).all()
    assert 0.0 < sure.sensitivity["F"] < 1e-9 * np.abs(sure.result.F).max()
