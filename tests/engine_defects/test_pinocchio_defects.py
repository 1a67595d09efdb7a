"""Pinocchio 4.1.0: derivatives of loops, residuals, redundant loops, MJCF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known import control, defect

pytestmark = [
    pytest.mark.parametrize("engine_name", ["pinocchio"], indirect=True),
    pytest.mark.usefixtures("engine_name"),
]


def chains(*kinds: tuple[str, ...]) -> tuple[Any, list[int]]:
    """A model of chains that start at the universe, and the last joint of each."""
    import pinocchio as pin

    model, ends = pin.Model(), []
    for c, chain in enumerate(kinds):
        joint = 0
        for k, kind in enumerate(chain):
            placement = pin.SE3(np.eye(3), np.array([0.1, 0.2, 0.3]) + 0.1 * k + 0.5 * c)
            joint = model.addJoint(joint, getattr(pin, f"JointModel{kind}")(), placement, f"joint{c}{k}")
            inertia = pin.Inertia(1.0 + k, np.array([0.1, 0.05, 0.2]), np.diag([0.3, 0.4, 0.5]))
            model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
        ends.append(joint)
    return model, ends


class Loop:
    """Chains whose ends meet in one point, as often as `copies` says."""

    def __init__(self, *kinds: tuple[str, ...], copies: int = 1) -> None:
        import pinocchio as pin

        self.pin: Any = pin
        self.model, (a, b) = chains(*kinds)
        self.data = self.model.createData()
        at_a, at_b = (pin.SE3(np.eye(3), np.array(p)) for p in ([0.3, 0.1, -0.2], [0.2, 0.2, 0.2]))
        self.models, self.datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for _ in range(copies):
            frame = pin.ReferenceFrame.LOCAL
            one = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, self.model, a, at_a, b, at_b, frame)
            self.models.append(one)
            self.datas.append(one.createData())
        pin.initConstraintDynamics(self.model, self.data, self.models, self.datas)
        rng = np.random.default_rng(1)
        self.q, self.v, self.tau = (rng.normal(size=self.model.nv) * size for size in (0.5, 1.0, 1.0))

    def accelerations(self, settings: Any, q: np.ndarray | None = None) -> np.ndarray:
        at = self.q if q is None else q
        model, data, pairs = self.model, self.data, (self.models, self.datas)
        return self.pin.constraintDynamics(model, data, at, self.v, self.tau, *pairs, settings).copy()

    def gap(self) -> float:
        """Acceleration at which the loop opens under what was computed last [m/s^2]."""
        pin, model, data, loop = self.pin, self.model, self.data, self.models[0]
        pin.forwardKinematics(model, data, self.q, self.v, data.ddq)

        def acceleration(joint: int, placement: Any) -> np.ndarray:
            at, v, a = placement.translation, data.v[joint], data.a[joint]
            speed = v.linear + np.cross(v.angular, at)
            return data.oMi[joint].rotation @ (a.linear + np.cross(a.angular, at) + np.cross(v.angular, speed))

        ends = ((loop.joint1_id, loop.joint1_placement), (loop.joint2_id, loop.joint2_placement))
        one, other = (acceleration(*end) for end in ends)
        return float(np.abs(one - other).max())


def derivative_error(first: str) -> np.ndarray:
    """Error of each column of ddq_dq against central differences, over the largest entry."""
    loop, h = Loop((first, "RY"), ("RX", "RZ", "RY")), 1e-6
    pin = loop.pin

    def settings() -> Any:
        return pin.ProximalSettings(0.0, 1e-12, 10)

    steps = h * np.eye(loop.model.nv)
    wanted = np.array(
        [
            (loop.accelerations(settings(), loop.q + e) - loop.accelerations(settings(), loop.q - e)) / (2 * h)
            for e in steps
        ]
    ).T
    loop.accelerations(settings())
    pin.computeConstraintDynamicsDerivatives(loop.model, loop.data, loop.models, loop.datas, settings())
    return np.abs(loop.data.ddq_dq - wanted).max(axis=0) / np.abs(wanted).max()


@defect(
    "computeConstraintDynamicsDerivatives: column 0 is wrong for CONTACT_3D between two joints where the first joint"
    " turns",
    "nothing, no derivative of Pinocchio's is used; they may be, where a joint that slides stands first",
)
def test_derivatives_of_a_loop_whose_first_joint_turns() -> None:
    control(bool((derivative_error("PX") < 1e-6).all()))  # central differences have ten digits
    error = derivative_error("RZ")
    control(bool((error[1:] < 1e-6).all()))
    assert error[0] < 1e-6


@defect(
    "ProximalSettings.absolute_residual leaves the accelerations out and is of the order 1 where the solution is exact",
    "ITERATIONS in pinocchio_.py, a fixed number of steps without an accuracy to stop at",
)
def test_the_absolute_residual_of_an_exact_solution_is_small() -> None:
    loop = Loop(("RZ", "RY"), ("RX", "RZ", "RY"))
    settings = loop.pin.ProximalSettings(1e-12, 1e-8, 10)
    loop.accelerations(settings)
    control(loop.gap() < 1e-12)
    assert settings.absolute_residual < 1e-9


@defect(
    "constraintDynamics with mu = 0 answers NaN for loops that are there twice, and raises nothing",
    "MU in pinocchio_.py and SolverEngine.solved, which looks at the answer",
)
def test_redundant_loops_are_solved_or_refused() -> None:
    loop = Loop(("RZ", "RY"), ("RX", "RZ", "RY"), copies=2)
    pin = loop.pin
    control(bool(np.isfinite(loop.accelerations(pin.ProximalSettings(0.0, 1e-8, 10))).all()))
    try:
        a = loop.accelerations(pin.ProximalSettings(0.0, 0.0, 1))
    except Exception:
        return
    assert np.isfinite(a).all()


def mjcf(folder: Path, bodies: str) -> Any:
    import pinocchio as pin

    file = folder / "model.xml"
    file.write_text(f'<mujoco><option gravity="1 2 3" /><worldbody>{bodies}</worldbody></mujoco>')
    return pin.buildModelFromMJCF(str(file))


INERTIAL = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1" />'
ONE = f'<body name="one">{INERTIAL}<joint name="a" type="hinge" axis="0 0 1" /></body>'
URDF = "PinocchioEngine.__init__, which reads the URDF, and sets gravity, because of it"


@defect("buildModelFromMJCF reads the first body of the world and no other", URDF)
def test_every_body_of_a_world_is_read(tmp_path: Path) -> None:
    control(mjcf(tmp_path, ONE).nv == 1)
    assert mjcf(tmp_path, ONE + ONE.replace("one", "two").replace('"a"', '"b"')).nv == 2


@defect("buildModelFromMJCF leaves gravity at -9.81 along z", URDF)
def test_gravity_is_read(tmp_path: Path) -> None:
    assert mjcf(tmp_path, ONE).gravity.linear.tolist() == [1.0, 2.0, 3.0]


@defect("buildModelFromMJCF drops the place of a body that has no joint", URDF)
def test_the_place_of_a_fixed_body_is_read(tmp_path: Path) -> None:
    fixed = f'<body name="hull" pos="1 2 3">{INERTIAL}{ONE}</body>'
    control(
        mjcf(tmp_path, ONE.replace('name="one"', 'name="one" pos="1 2 3"')).jointPlacements[1].translation[0] == 1.0
    )
    assert mjcf(tmp_path, fixed).jointPlacements[1].translation.tolist() == [1.0, 2.0, 3.0]
