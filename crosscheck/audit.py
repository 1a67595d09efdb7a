"""The audit of the paper's text: each row of the table, measured on built-in scenes against certified truth.

The cases give the rows what does not come from the formulas: the certified reference's forces, moments and lengths,
levers turned by a rotation of its own, guide axes from the directions of the legs, inertias put together body by body.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..analytic import PlatformMotion
from ..analytic.audit import MARGIN, Case, Row
from ..analytic.audit_equations import EQUATIONS
from ..analytic.audit_misprints import CONTROLS, MISPRINTS
from ..analytic.audit_planar import PLANAR, PLANAR_MISPRINTS
from ..analytic.audit_text import TEXT
from ..models import Scene, load_scene
from .engine import REFERENCE, DynamicsResult, EngineError, load_engine, quantity
from .trajectory import Trajectory, from_scene

if TYPE_CHECKING:
    import pandas as pd

SAMPLES = 9
"""Samples of each scene's own motion: enough for every term to be large somewhere."""

TABLE: tuple[Row, ...] = (*EQUATIONS, *PLANAR, *MISPRINTS, *PLANAR_MISPRINTS, *CONTROLS, *TEXT)

HOLDS, FAILS, TEXT_ONLY = "pass", "fail", "text"

COLUMNS = [
    "row", "kind", "equation", "states", "where", "scenes", "residual", "tolerance", "tolerance_name",
    "printed_residual", "verdict", "printed", "correct", "probably_scan", "reason",
]  # fmt: skip


class _Rows(NamedTuple):
    """Instants of a motion as the reference reads them; a trajectory has the same names."""

    t: np.ndarray
    position: np.ndarray
    quaternion: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray
    acceleration: np.ndarray
    angular_acceleration: np.ndarray
    condition: np.ndarray
    sin_q_n: np.ndarray


def cases() -> dict[str, Case]:
    """Everything that the table is measured on, by name. Raises EngineError without the reference."""
    scenes = [load_scene(name) for name in ("hexapod", "planar3", "pointmass2", "collinear")]
    scenes += [inclined("hexapod", (3.1, -8.7, 2.3)), inclined("planar3", (2.7, -9.1, 0.0))]
    found = [case_of(scene, from_scene(scene, SAMPLES)) for scene in scenes]
    return {case.name: case for case in (*found, case_of(*sagging(-7.5)))}


def refused(row: Row, case: Case) -> bool:
    """Whether the row's function refuses a case that it does not hold for."""
    assert row.residual
    try:
        row.residual(case)
    except ValueError:
        return True
    return False


def measured(row: Row, cases: Mapping[str, Case]) -> dict[str, object]:
    """One row of the table with its numbers and verdict, by the names of `COLUMNS`.

    The residual is the largest of the row's cases, that of the printed reading the smallest: it must show on each.
    """
    found: dict[str, object] = {
        "row": row.key, "kind": row.kind, "equation": row.equation, "states": row.states, "where": " ".join(row.where),
        "scenes": " ".join(row.scenes), "printed": row.prints, "correct": row.correct,
        "probably_scan": "yes" if row.scan else "",
    }  # fmt: skip
    if row.residual is None or row.tolerance is None:
        return found | {"verdict": TEXT_ONLY}
    residual = float(np.max([row.residual(cases[name]) for name in row.scenes]))
    found |= {"residual": residual, "tolerance": row.tolerance.value, "tolerance_name": row.tolerance.name}
    wrong = [f"accepts {name}, expected ValueError" for name in row.refuses if not refused(row, cases[name])]
    if not residual <= row.tolerance.value:
        wrong.append(f"residual {residual:.2e}, allowed {row.tolerance.value:.1e} ({row.tolerance.name})")
    if row.printed is not None:
        shown, least = float(np.min([row.printed(cases[name]) for name in row.scenes])), MARGIN * row.tolerance.value
        found["printed_residual"] = shown
        if not shown >= least:
            wrong.append(f"printed reading misses by {shown:.2e}, expected at least {least:.1e}")
    return found | {"verdict": FAILS if wrong else HOLDS, "reason": "; ".join(wrong)}


def audit(table: Sequence[Row] = TABLE) -> pd.DataFrame:
    """The table with every residual and verdict, columns `COLUMNS`. Raises EngineError without the reference."""
    import pandas as pd

    known = cases()
    return pd.DataFrame([measured(row, known) for row in table], columns=COLUMNS)


def inclined(name: str, gravity: tuple[float, float, float]) -> Scene:
    """A built-in scene under another gravity."""
    return load_scene(name).model_copy(update={"name": f"{name}_inclined", "gravity": gravity})


def sagging(y_acceleration: float) -> tuple[Scene, _Rows]:
    """Example 3 with gravity and a given y_p'': two legs along x_r, momentarily not turning.

    All numbers are short binary fractions for which the y_p'' that gravity forces is exactly -7.5 m/s^2: any other
    float is refused by the reference, even one that is off by rounding.
    """
    scene = load_scene("collinear")
    leg = scene.leg.model_copy(
        update={
            "a": 0.25,
            "guide": scene.leg.guide.model_copy(update={"mass": 2.0, "com": 0.25, "J_x": 0.625}),
            "rod": scene.leg.rod.model_copy(update={"mass": 2.0, "J_x": 0.25}),
        }
    )
    scene = scene.model_copy(
        update={
            "name": "collinear_sagging",
            "gravity": (0.0, -10.0, 0.0),
            "leg": leg,
            "platform": scene.platform.model_copy(update={"mass": 2.0}),
            "hull": scene.hull.model_copy(update={"pins": ((0.0, 0.0, 0.0), (1.5, 0.0, 0.0))}),
        }
    )
    t = np.arange(5.0)
    zero = np.zeros((len(t), 3))
    x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    return scene, _Rows(
        t=t,
        position=zero + 0.5 * x,
        quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)),
        velocity=np.outer([0.0, 0.5, -1.5, 0.25, 2.0], x),
        angular_velocity=zero,
        acceleration=np.outer([0.0, 3.0, -2.0, 11.0, -7.0], x) + y_acceleration * y,
        angular_acceleration=zero,
        condition=np.ones(len(t)),
        sin_q_n=np.ones(len(t)),
    )


def _truth(scene: Scene, result: DynamicsResult) -> dict[str, np.ndarray]:
    found = {name: quantity(scene, name, result.F, result.reactions) for name in scene.quantities if name != "F"}
    return {"F": result.F, "L": result.L, "dL": result.dL} | found


def composed_inertia(scene: Scene, q_s: np.ndarray) -> np.ndarray:
    """J_q, J_y, m_q (..., 3) of guide and rod about O_n by the theorem of parallel axes, central tensors in guide axes.

    ``q_s``: distances of the rod's centre of mass, any shape.
    """
    guide, rod = scene.leg.guide, scene.leg.rod
    tensor, first = np.zeros((*q_s.shape, 3, 3)), np.zeros(q_s.shape)
    parts = (
        (guide.mass, np.full(q_s.shape, guide.com), (guide.central_J_x, guide.J_y, guide.central_J_x)),
        (rod.mass, q_s, (rod.J_x, rod.J_z, rod.J_x)),
    )
    for mass, distance, central in parts:
        c = distance[..., None] * np.array([0.0, 1.0, 0.0])
        square = np.sum(c * c, axis=-1)[..., None, None] * np.eye(3) - c[..., :, None] * c[..., None, :]
        tensor += np.diag(central) + mass * square
        first += mass * distance
    return np.stack([tensor[..., 0, 0], tensor[..., 1, 1], first], axis=-1)


def case_of(scene: Scene, rows: _Rows | Trajectory) -> Case:
    """What is known of a scene's motion without the formulas. Raises EngineError."""
    from scipy.spatial.transform import Rotation

    try:
        reference = load_engine(REFERENCE)(scene)
    except ImportError as e:
        raise EngineError(f"the certified reference is needed and its package is missing: {e}") from None
    truth = _truth(scene, reference.inverse_dynamics(rows))  # pyright: ignore[reportArgumentType] # reads these alone
    R = Rotation.from_quat(rows.quaternion, scalar_first=True).as_matrix()
    r = np.einsum("tij,nj->tni", R, np.array(scene.pins))
    tip = (rows.position[:, None] - np.array(scene.hull.pins)) + r
    y = tip / np.linalg.norm(tip, axis=2, keepdims=True)
    z = np.broadcast_to([0.0, 0.0, 1.0], y.shape)
    if scene.topology == "spatial":
        across = np.cross([0.0, 1.0, 0.0], y)
        z = across / np.linalg.norm(across, axis=2, keepdims=True)
    moments, V = np.linalg.eigh(np.array(scene.platform.tensor))
    V[:, 2] = np.cross(V[:, 0], V[:, 1])
    motion = PlatformMotion(
        rows.position, R, rows.velocity, rows.angular_velocity, rows.acceleration, rows.angular_acceleration
    )
    return Case(
        name=scene.name,
        P=scene.parameters,
        motion=motion,
        r=r,
        axes=np.stack([np.cross(y, z), y, z], axis=2),
        inertia=composed_inertia(scene, truth["L"] - scene.leg.a),
        principal=(moments, (R @ V).transpose(0, 2, 1)),
        truth=truth,
    )
