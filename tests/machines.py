"""Random hexapods without any symmetry, and a dense Newton-Euler.

Its bodies and equations share nothing with formulas or reference; the joint coordinates, rates and accelerations come
from the trajectory, as for the engines, and the certified reference is what covers those.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from stewart_crosscheck.analytic import PlatformMotion
from stewart_crosscheck.crosscheck.trajectory import Trajectory, TrajectoryError, along, from_scene
from stewart_crosscheck.models import Scene


def _inertia(rng: np.random.Generator, low: float, high: float) -> list[list[float]]:
    """A central inertia that a body can have: the second moments of a random cloud of points."""
    points = rng.normal(size=(8, 3)) * rng.uniform(low, high, 3)
    full = np.sum(points**2) * np.eye(3) - points.T @ points
    return (0.5 * (full + full.T)).tolist()


def random_scene(seed: int, base: bool = True, gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)) -> Scene:
    """A hexapod with random pins, inertias, motion and load; row-scaled condition below 60, sin q_n above 0.15."""
    rng = np.random.default_rng(seed)
    while True:
        angle = np.linspace(0, 2 * np.pi, 6, endpoint=False)
        shift = rng.choice([-1.0, 1.0]) * np.array([1, -1, 1, -1, 1, -1])
        ring = lambda r, a: np.column_stack([r * np.cos(a), rng.uniform(-0.08, 0.08, 6), r * np.sin(a)])  # noqa: E731
        p = ring(rng.uniform(0.25, 0.45, 6), angle + 0.35 * shift + rng.uniform(-0.15, 0.15, 6))
        O = ring(rng.uniform(0.6, 1.1, 6), angle - 0.25 * shift + rng.uniform(-0.15, 0.15, 6))
        m_n, a_n, J_c = rng.uniform(1, 5), rng.uniform(-0.1, 0.4), rng.uniform(0.05, 0.2)
        J_x = rng.uniform(0.05, 0.2)

        def wave(scale: float, c0: float) -> dict[str, Any]:
            return {"c0": c0, "terms": [[rng.uniform(0.3, 1) * scale, rng.uniform(2, 5), rng.uniform(0, 6)]]}

        data: dict[str, Any] = {
            "schema": 1,
            "name": f"random{seed}",
            "topology": "spatial",
            "gravity": list(gravity),
            "leg": {
                "a": rng.uniform(-0.1, 0.5),
                "guide": {"mass": m_n, "com": a_n, "J_x": J_c + m_n * a_n**2, "J_y": rng.uniform(0.01, 1.9) * J_c},
                "rod": {"mass": rng.uniform(1, 5), "J_x": J_x, "J_z": rng.uniform(0.01, 1.9) * J_x},
            },
            "platform": {"mass": rng.uniform(5, 60), "inertia": _inertia(rng, 0.1, 0.5), "pins": p.tolist()},
            "hull": {"pins": O.tolist()},
            "motion": {
                "duration": 1.0,
                "position": [wave(0.08, 0.02), wave(0.08, rng.uniform(0.7, 1.1)), wave(0.08, -0.03)],
                "orientation": {"kind": "rotation_vector", "components": [wave(0.15, 0.05) for _ in range(3)]},
            },
            "load": {name: rng.normal(size=3).tolist() for name in ("force", "moment", "point")},
        }
        if base:
            data["leg"]["base"] = {"mass": rng.uniform(1, 5), "J_z": rng.uniform(0.005, 0.05)}
        scene = Scene.model_validate(data)
        try:
            trajectory = from_scene(scene, 5)
        except TrajectoryError:
            continue
        if trajectory.condition.max() < 60 and trajectory.sin_q_n.min() > 0.15:
            return scene


def random_planar(seed: int, point: bool) -> Scene:
    """Three legs and a bar, or two and a point mass, in a plane: inclined gravity, load; condition below 30."""
    rng = np.random.default_rng(seed)
    while True:
        N = 2 if point else 3
        m_n, a_n, J_c = rng.uniform(1, 5), rng.uniform(-0.1, 0.4), rng.uniform(0.05, 0.2)

        def wave(scale: float, c0: float) -> dict[str, Any]:
            return {"c0": c0, "terms": [[rng.uniform(0.3, 1) * scale, rng.uniform(2, 5), rng.uniform(0, 6)]]}

        def flat(n: int, scale: float) -> list[list[float]]:
            return np.column_stack([rng.uniform(-scale, scale, (n, 2)), np.zeros(n)]).tolist()

        data: dict[str, Any] = {
            "schema": 1,
            "name": f"planar{seed}",
            "topology": "planar",
            "gravity": [rng.uniform(-5, 5), rng.uniform(-9, 9), 0.0],
            "leg": {
                "a": rng.uniform(-0.1, 0.4),
                "guide": {"mass": m_n, "com": a_n, "J_x": J_c + m_n * a_n**2},
                "rod": {"mass": rng.uniform(1, 5), "J_x": rng.uniform(0.05, 0.2)},
            },
            "platform": {"mass": rng.uniform(5, 30)},
            "hull": {"pins": flat(N, 1.2)},
            "motion": {"duration": 1.0, "position": [wave(0.1, 0.3), wave(0.1, rng.uniform(0.5, 1.2)), {}]},
            "load": {"force": [*rng.normal(size=2).tolist(), 0.0]},
        }
        if not point:
            data["platform"] |= {"J_z": rng.uniform(0.1, 1), "pins": flat(N, 0.5)}
            turn = {"kind": "rotation_vector", "components": [{}, {}, wave(0.3, rng.uniform(-3, 3))]}
            data["motion"]["orientation"] = turn
            data["load"] |= {"moment": [0.0, 0.0, rng.normal()], "point": flat(1, 0.5)[0]}
        scene = Scene.model_validate(data)
        try:
            trajectory = from_scene(scene, 7)
        except TrajectoryError:
            continue
        if trajectory.condition.max() < 30:
            return scene


def with_legs(scene: Scene, N: int) -> Scene:
    """The scene with its first legs, or with more of them between the others; without motion."""
    data = scene.model_dump(exclude_none=True, by_alias=True)
    data.pop("motion")
    for part in ("platform", "hull"):
        pins = np.array(data[part]["pins"])
        data[part]["pins"] = np.vstack([pins, 0.5 * (pins + np.roll(pins, 1, axis=0))])[:N].tolist()
    return Scene.model_validate(data)


def motion_at(scene: Scene, t: float) -> tuple[PlatformMotion, list[float]]:
    """The scene's own motion at any one time as plain floats, and its quaternion."""
    one = along(scene, np.array([t]))
    return PlatformMotion(*(np.asarray(a)[0].tolist() for a in one.motion)), one.quaternion[0].tolist()


def _cross_matrix(v: np.ndarray) -> np.ndarray:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def newton_euler_equations(
    scene: Scene, trajectory: Trajectory, k: int
) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Six equations per body of sample k and two per leg, M_o . y_r = M_n . z_n = 0: A x = b, moments about the ORIGIN.

    Unknowns per leg: wrenches of base, guide and rod joints (moment about the joint's point, force) and the force at
    the tip.  Kinematics by the chain rule from joint coordinates and rotation matrices.  Third: y_n of each leg.
    """
    g = np.array(scene.gravity)
    leg = scene.leg
    base = leg.base
    assert base is not None
    A, b = np.zeros((20 * scene.N + 6, 21 * scene.N)), np.zeros(20 * scene.N + 6)
    up = np.array([0.0, 1.0, 0.0])
    R = trajectory.rotation[k]
    C, aC = trajectory.position[k], trajectory.acceleration[k]
    w, dw = trajectory.angular_velocity[k], trajectory.angular_acceleration[k]
    P = 6 * 3 * scene.N  # first platform row

    def body_rows(row: int, mass: float, com: np.ndarray, acc: np.ndarray, dH: np.ndarray) -> None:
        b[row : row + 3] = mass * (acc - g)
        b[row + 3 : row + 6] = dH + np.cross(com, mass * (acc - g))

    def put(row: int, column: int, sign: float, point: np.ndarray, with_moment: bool) -> None:
        """A wrench (moment, force) or a force at a point on the body of a row."""
        f = column + 3 if with_moment else column
        A[row : row + 3, f : f + 3] += sign * np.eye(3)
        A[row + 3 : row + 6, f : f + 3] += sign * _cross_matrix(point)
        if with_moment:
            A[row + 3 : row + 6, column : column + 3] += sign * np.eye(3)

    def inertia_rate(axes: np.ndarray, J: np.ndarray, omega: np.ndarray, alpha: np.ndarray) -> np.ndarray:
        I_W = axes @ J @ axes.T
        return I_W @ alpha + np.cross(omega, I_W @ omega)

    ys = []
    for i in range(scene.N):
        (q_o, q_n, q_s), (v_o, v_n, v_s), (a_o, a_n, a_s) = (
            [x[f"{c}{i + 1}"][k] for c in "ons"] for x in (trajectory.q, trajectory.v, trajectory.a)
        )
        Ry = np.array([[np.cos(q_o), 0, np.sin(q_o)], [0, 1, 0], [-np.sin(q_o), 0, np.cos(q_o)]])
        Rz = np.array([[np.cos(q_n), -np.sin(q_n), 0], [np.sin(q_n), np.cos(q_n), 0], [0, 0, 1]])
        axes = Ry @ Rz
        y, z = axes[:, 1], Ry[:, 2]
        ys.append(y)
        omega = v_o * up + v_n * z
        alpha = a_o * up + a_n * z + v_o * v_n * np.cross(up, z)
        spin = _cross_matrix(alpha) + _cross_matrix(omega) @ _cross_matrix(omega)
        O = np.array(scene.hull.pins[i])
        J_c = leg.guide.J_x - leg.guide.mass * leg.guide.com**2
        J_n, J_s = np.diag([J_c, leg.guide.J_y, J_c]), np.diag([leg.rod.J_x, leg.rod.J_z, leg.rod.J_x])
        c_n, c_s = leg.guide.com * y, q_s * y
        a_rod = spin @ c_s + 2 * v_s * np.cross(omega, y) + a_s * y
        row, col = 18 * i, 21 * i
        body_rows(row, base.mass, O, 0 * O, base.J_z * a_o * up)
        body_rows(row + 6, leg.guide.mass, O + c_n, spin @ c_n, inertia_rate(axes, J_n, omega, alpha))
        body_rows(row + 12, leg.rod.mass, O + c_s, a_rod, inertia_rate(axes, J_s, omega, alpha))
        tip = O + (q_s + leg.a) * y
        put(row, col, 1, O, True)  # o on base
        put(row, col + 6, -1, O, True)  # n: reaction on base
        put(row + 6, col + 6, 1, O, True)
        put(row + 6, col + 12, -1, O + c_s, True)
        put(row + 12, col + 12, 1, O + c_s, True)
        put(row + 12, col + 18, 1, tip, False)
        put(P, col + 18, -1, tip, False)
        passive = P + 6 + 2 * i  # M_o . up = 0, M_n . z = 0
        A[passive, col : col + 3] = up
        A[passive + 1, col + 6 : col + 9] = z
    body_rows(P, scene.platform.mass, C, aC, inertia_rate(R, np.array(scene.platform.tensor), w, dw))
    if scene.load:
        f, at = np.array(scene.load.force), C + R @ scene.load.point
        b[P : P + 3] -= f
        b[P + 3 : P + 6] -= np.cross(at, f) + scene.load.moment
    return A, b, ys


def dense_newton_euler(scene: Scene, trajectory: Trajectory, k: int) -> dict[str, np.ndarray]:
    """All reactions of sample k of a hexapod from one 126 x 126 system."""
    A, b, ys = newton_euler_equations(scene, trajectory, k)
    x = np.linalg.solve(A, b).reshape(scene.N, 21)
    parts = ("M_o", "F_o", "M_n", "F_n", "M_s", "F_s", "F_r")
    out = {name: x[:, 3 * j : 3 * j + 3] for j, name in enumerate(parts)}
    out["F"] = np.einsum("ij,ij->i", out["F_s"], np.array(ys))
    return out
