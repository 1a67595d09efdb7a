"""Signs, frames and points of every engine's wrenches, on one hanging mass whose answer is m g."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from conftest import keyed

from stewart_crosscheck.crosscheck import wrench
from stewart_crosscheck.crosscheck.compare import agreement
from stewart_crosscheck.crosscheck.engine import load_engine, quantity
from stewart_crosscheck.crosscheck.trajectory import Trajectory, from_scene
from stewart_crosscheck.models import Scene

MASS, G = 3.0, np.array([0.7, -9.0, 1.1])
COM = np.array([0.2, -0.3, 0.5])  # of the hanging body, in its axes, from its joint
HINGE = np.array([1.0, 2.0, -0.5])  # in the world
AXIS = np.array([0.0, 0.6, 0.8])
ANGLE = 0.7

URDF = f"""<robot name="hanging"><link name="world"/><link name="mass"><inertial>
<origin xyz="{COM[0]} {COM[1]} {COM[2]}" rpy="0 0 0"/><mass value="{MASS}"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="world"/><child link="mass"/>
<origin xyz="{HINGE[0]} {HINGE[1]} {HINGE[2]}" rpy="0 0 0"/><axis xyz="{AXIS[0]} {AXIS[1]} {AXIS[2]}"/>
<limit lower="-9" upper="9" effort="9" velocity="9"/></joint></robot>"""

MJCF = f"""<mujoco><compiler angle="radian"/><option gravity="{G[0]} {G[1]} {G[2]}"/><worldbody>
<body name="mass" pos="{HINGE[0]} {HINGE[1]} {HINGE[2]}">
<inertial mass="{MASS}" pos="{COM[0]} {COM[1]} {COM[2]}" diaginertia="0.1 0.1 0.1"/>
<joint name="hinge" axis="{AXIS[0]} {AXIS[1]} {AXIS[2]}"/></body></worldbody></mujoco>"""


def _rodrigues() -> np.ndarray:
    x, y, z = AXIS
    N = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(ANGLE) * N + (1 - np.cos(ANGLE)) * N @ N


def expected() -> np.ndarray:
    """The hinge carries the weight: force -m g, moment about the hinge -(R com) x m g, on the mass."""
    weight = MASS * G
    return np.concatenate([-np.cross(_rodrigues() @ COM, weight), -weight])


def _mujoco() -> np.ndarray:
    import mujoco

    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    data.qpos[0] = ANGLE
    mujoco.mj_inverse(model, data)
    mujoco.mj_rnePostConstraint(model, data)
    center = data.subtree_com[model.body_rootid[1]]
    return wrench.from_mujoco(data.cfrc_int[1], center, data.xanchor[0])


def _pinocchio() -> np.ndarray:
    import pinocchio as pin

    model = pin.buildModelFromXML(URDF)
    model.gravity.linear = G
    data = model.createData()
    pin.rnea(model, data, np.array([ANGLE]), np.zeros(1), np.zeros(1))
    pin.forwardKinematics(model, data, np.array([ANGLE]))
    return wrench.from_pinocchio(data.f[1].vector, data.oMi[1].rotation)


def _dart() -> np.ndarray:
    dart = importlib.import_module("dartpy")
    skeleton = dart.utils.DartLoader().parseSkeletonString(URDF, "")
    skeleton.setGravity(G)
    skeleton.setPosition(skeleton.getDof("hinge").getIndexInSkeleton(), ANGLE)
    skeleton.computeInverseDynamics(True, False, False)
    body = skeleton.getBodyNode("mass")
    return wrench.from_dart(body.getBodyForce(), body.getWorldTransform().rotation())


def test_hanging_mass(engine_name: str) -> None:
    got = {"mujoco": _mujoco, "pinocchio": _pinocchio, "dart": _dart}[engine_name]()
    np.testing.assert_allclose(got, expected(), rtol=0, atol=1e-13)  # N and N m of some ten: rounding


def test_the_hanging_mass_tells_signs_frames_and_points_apart() -> None:
    """Each wrong convention gives another wrench, far from the right one."""
    right, R = expected(), _rodrigues()
    wrong = {
        "sign": -right,
        "order": np.roll(right, 3),
        "axes of the body": wrench.from_dart(right, R.T),
        "moment about the centre of mass": wrench.shifted(right, HINGE, HINGE + R @ COM),
        "moment about the world's origin": wrench.shifted(right, HINGE, np.zeros(3)),
    }
    for name, value in wrong.items():
        assert np.abs(value - right).max() > 1.0, name


def test_a_shifted_wrench_does_the_same_work() -> None:
    """Power on a rigid motion does not depend on the point that moments are taken about."""
    rng = np.random.default_rng(0)
    w, p, new = rng.normal(size=6), rng.normal(size=3), rng.normal(size=3)
    omega, v_p = rng.normal(size=3), rng.normal(size=3)
    v_new = v_p + np.cross(omega, new - p)
    moved = wrench.shifted(w, p, new)
    assert moved[:3] @ omega + moved[3:] @ v_new == pytest.approx(w[:3] @ omega + w[3:] @ v_p, abs=1e-14)  # rounding


def test_a_loop_force_has_no_moment() -> None:
    assert wrench.of_loop(np.array([1.0, 2.0, 3.0])).tolist() == [0, 0, 0, 1, 2, 3]


# --- What the hull feels ----------------------------------------------------------------------------------------------


def test_a_hull_carries_the_weight_of_a_mechanism_at_rest(hexapod: Scene) -> None:
    """By hand: 77.1 kg times 9.81 downwards, from the truth's momentum and from the sum of its reactions."""
    data = hexapod.model_dump(by_alias=True)
    data["motion"]["position"] = ({"c0": 0.02}, {"c0": 0.94}, {"c0": -0.01})
    data["motion"]["orientation"]["components"] = ({}, {}, {})
    scene = Scene.model_validate(data)
    truth = load_engine("reference")(scene).inverse_dynamics(from_scene(scene, 1))
    assert truth.hull is not None
    weight = [0.0, -9.81 * sum(body.mass for body in scene.bodies), 0.0]
    np.testing.assert_allclose(truth.hull[0, 3:], weight, rtol=0, atol=1e-12)  # of 756 N
    np.testing.assert_allclose(quantity(scene, "F_hull", truth.F, truth.reactions)[0, 0], weight, rtol=0, atol=1e-12)


def test_the_hull_is_the_sum_of_its_joints_about_the_mean_of_its_pins() -> None:
    """Two forces at two pins, by hand: their sum the other way, and the moment of their difference."""
    on_children = np.zeros((1, 2, 6))
    on_children[0, 0, 3:], on_children[0, 1, 3:] = (0.0, 5.0, 0.0), (0.0, 3.0, 0.0)
    on_children[0, 0, 2] = 0.5
    points = np.array([[1.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    # about x = 2: -1 * 5 + 1 * 3 + 0.5 on the children, the opposite on the hull
    np.testing.assert_array_equal(wrench.on_hull(on_children, points), [[0.0, 0.0, 1.5, 0.0, -8.0, 0.0]])


def test_reactions_that_miss_the_momentum_show_at_the_hull(hexapod: Scene, trajectory: Trajectory) -> None:
    """One base's reaction off by a millinewton: the hull's row says so, though no single sum was compared before."""
    engines = {name: load_engine(name) for name in ("analytic", "reference")}
    results = {name: e(hexapod).inverse_dynamics(trajectory) for name, e in engines.items()}
    first = next(j for j, joint in enumerate(hexapod.joints) if joint.parent == "hull")
    results["analytic"].reactions[4, first, 3] += 1e-3
    rows = agreement("id", hexapod, trajectory, engines, keyed(hexapod, trajectory, engines, results)).set_index(
        ["engine", "quantity"]
    )
    assert rows.loc[("analytic", "F_hull"), "verdict"] == "fail"
    assert rows.loc[("analytic", "F_hull"), "max_abs"] == pytest.approx(1e-3, rel=1e-9)
    assert rows.loc[("analytic", "F_hull"), "where"] == f"hull, t = {trajectory.t[4]:.6g} s"
