"""Trajectories: a platform motion from a scene or a CSV file, and the consistent joint coordinates of every leg."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from .. import analytic
from ..analytic import Infeasible, PlatformMotion, SingularPose
from ..models.reading import printable
from ..models.scene import Scene
from ..models.tables import LARGEST, Component
from . import quaternions
from .conditioning import conditioning
from .hard import Row
from .quaternions import Jet, rotation
from .trajectory_csv import POSE, RATES, TrajectoryError, read_columns, wanted_columns
from .waves import sines

SAMPLES = 201
"""Samples of a scene's own motion, unless another number is asked for."""

BLOCK = 2000
"""Samples at a time: an engine's matrices of one block take some 30 MB."""

_UNTURNED = (Component(), Component(), Component())

SPLINE_ROWS = 6
"""Rows that a quintic spline needs."""


@dataclass(frozen=True)
class Trajectory:
    """Samples of a consistent motion, SI units, world axes.

    ``t`` (nt,), ``position, velocity, angular_velocity, acceleration, angular_acceleration`` (nt, 3) of the platform's
    centre of mass, ``quaternion`` (nt, 4) of R_WP, scalar first, not necessarily of exact length 1; ``q, v, a``: per
    joint coordinate name an array (nt,), a planar platform's own among them; ``condition, undetermined, sin_q_n,
    reach`` (nt,): see `Conditioning`; ``source``: where the motion came from, for reports and errors.
    """

    t: np.ndarray
    position: np.ndarray
    quaternion: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray
    acceleration: np.ndarray
    angular_acceleration: np.ndarray
    q: dict[str, np.ndarray]
    v: dict[str, np.ndarray]
    a: dict[str, np.ndarray]
    condition: np.ndarray
    undetermined: np.ndarray
    sin_q_n: np.ndarray
    reach: np.ndarray
    source: str

    @property
    def rotation(self) -> np.ndarray:
        """R_WP, shape (nt, 3, 3)."""
        return rotation(self.quaternion)

    @property
    def unit_quaternion(self) -> np.ndarray:
        """Quaternion of length 1, shape (nt, 4)."""
        return self.quaternion / np.linalg.norm(self.quaternion, axis=1, keepdims=True)

    def blocks(self) -> Iterator[Trajectory]:
        """Views of `BLOCK` samples each, in their order: what is computed of all samples need not exist at once."""
        for first in range(0, len(self.t), BLOCK):
            yield self.at(slice(first, first + BLOCK))

    def at(self, samples: np.ndarray | slice) -> Trajectory:
        """Some of its samples."""

        def part(x: Any) -> Any:
            return {name: column[samples] for name, column in x.items()} if isinstance(x, dict) else x[samples]

        return replace(self, **{f.name: part(getattr(self, f.name)) for f in fields(self) if f.name != "source"})

    def without_accelerations(self) -> Trajectory:
        """The same poses and velocities; what forward dynamics has to find is NaN."""
        unknown = np.full_like(self.acceleration, np.nan)
        a = {name: np.full_like(x, np.nan) for name, x in self.a.items()}
        return replace(self, acceleration=unknown, angular_acceleration=unknown, a=a)

    def in_body(self, v_W: np.ndarray) -> np.ndarray:
        """Vectors (nt, 3) in the platform's axes."""
        return np.einsum("tji,tj->ti", self.rotation, v_W)

    @property
    def motion(self) -> PlatformMotion:
        """The platform's motion as the formulas take it."""
        return PlatformMotion(
            self.position,
            self.rotation,
            self.velocity,
            self.angular_velocity,
            self.acceleration,
            self.angular_acceleration,
        )


def _coordinates(scene: Scene, motion: PlatformMotion, q: np.ndarray) -> tuple[dict[str, np.ndarray], ...]:
    """Coordinates, rates and accelerations by name: the legs', and those of a platform that moves in the plane."""
    k = analytic.inverse_kinematics(scene.parameters, motion)
    legs = (
        {"o": k.q_o, "n": k.q_n, "s": k.q_s},
        {"o": k.dq_o, "n": k.dq_n, "s": k.dq_s},
        {"o": k.ddq_o, "n": k.ddq_n, "s": k.ddq_s},
    )
    angle = np.unwrap(2.0 * np.arctan2(q[:, 3], q[:, 0]))
    platform = (
        (motion.C_p[:, 0], motion.C_p[:, 1], angle),
        (motion.dC_p[:, 0], motion.dC_p[:, 1], motion.w_p[:, 2]),
        (motion.ddC_p[:, 0], motion.ddC_p[:, 1], motion.dw_p[:, 2]),
    )
    return tuple(
        {c: leg[c[0]][:, int(c[1:]) - 1] for c in scene.coordinates}
        | dict(zip(scene.platform_coordinates, own, strict=False))
        for leg, own in zip(legs, platform, strict=True)
    )


def _require_plane(scene: Scene, source: str, motion: PlatformMotion, q: np.ndarray) -> None:
    """Raise TrajectoryError unless a planar scene's platform stays in the plane, and a point mass does not turn."""
    if scene.freedom == "spatial":
        return
    point = scene.freedom == "point"
    turning = [0, 1, 2] if point else [0, 1]
    wanted_zero = {
        "p_z, v_z, a_z": (motion.C_p[:, [2]], motion.dC_p[:, [2]], motion.ddC_p[:, [2]]),
        "q_x, q_y, q_z" if point else "q_x, q_y": (q[:, [1, 2, 3] if point else [1, 2]],),
        "w_x, w_y, ...": (motion.w_p[:, turning], motion.dw_p[:, turning]),
    }
    for columns, arrays in wanted_zero.items():
        wrong = np.flatnonzero(np.any(np.hstack(arrays) != 0.0, axis=1))
        if len(wrong):
            kind = "a point mass does not turn" if point else "a planar platform stays in x_r y_r"
            raise TrajectoryError(f"{source}: sample {wrong[0]}: {columns}: got a motion, expected zeros: {kind}")


def _build(
    scene: Scene,
    source: str,
    t: np.ndarray,
    p: Jet,
    q: np.ndarray,
    w: np.ndarray,
    dw: np.ndarray,
    inverse: bool = True,
    regular: bool = True,
) -> Trajectory:
    """Add the joint coordinates; refuse what has no inverse dynamics, if that is wanted (else its condition is NaN).

    Poses that need not be `regular` have a condition, however large.
    """
    motion = PlatformMotion(p[0], rotation(q), p[1], w, p[2], dw)
    _require_plane(scene, source, motion, q)
    try:
        with np.errstate(all="ignore"):  # a leg of length zero divides by it; it is refused by name just below
            found = conditioning(scene, p[0], motion.R, inverse, regular)
        coordinates = _coordinates(scene, motion, q)
        if found.undetermined.any():
            analytic.driving_forces(scene.parameters, motion)  # no forces may give this motion
    except (SingularPose, Infeasible) as e:
        kind = "singular pose: " if isinstance(e, SingularPose) else ""
        raise TrajectoryError(f"{source}: t = {t[e.sample]:.6g} s: {kind}{e}") from None
    x, v, a = coordinates
    return Trajectory(t, p[0], q, p[1], w, p[2], dw, x, v, a, *found, source=source)


def along(scene: Scene, t: np.ndarray, inverse: bool = True) -> Trajectory:
    """The scene's own motion at the times `t` (nt,) [s], in poses that have inverse dynamics. Raises TrajectoryError.

    Without `inverse` forward dynamics is all that the poses are asked for: it is regular where inverse dynamics is not.
    """
    source = f"{scene.source}: motion"
    if scene.motion is None:
        raise TrajectoryError(f"{source}: missing, expected a [motion] table or a trajectory file")
    orientation = scene.motion.orientation
    x = sines(orientation.components if orientation else _UNTURNED, t)
    q = quaternions.of_angles(orientation.kind if orientation else "rotation_vector", x)
    return _build(scene, source, t, sines(scene.motion.position, t), q[0], *quaternions.angular(q), inverse)


def instant(scene: Scene, row: Row, inverse: bool = True) -> Trajectory:
    """One row of a motion in any pose that has joint coordinates, singular ones too. Raises TrajectoryError.

    Without `inverse` no forces need give its accelerations.
    """
    p, q, v, w, a, dw = (np.array([x], dtype=float) for x in row)
    return _build(scene, scene.source, np.zeros(1), (p, v, a), q, w, dw, inverse, regular=False)


def platform_alone(scene: Scene, row: Row) -> Trajectory:
    """One row of a motion without joint coordinates, which not every pose has, and without a look at its condition."""
    p, q, v, w, a, dw = (np.array([x], dtype=float) for x in row)
    unknown = np.full(1, np.nan)
    return Trajectory(
        np.zeros(1), p, q, v, w, a, dw, {}, {}, {}, unknown, np.zeros(1, dtype=bool), unknown, unknown, scene.source
    )


def driving_forces(scene: Scene, t: np.ndarray) -> np.ndarray:
    """Closed-form driving forces (nt, N) [N] of the scene's own motion at the times `t`; `along` says if it has any."""
    return analytic.driving_forces(scene.parameters, along(scene, t, inverse=False).motion)


def initial(scene: Scene) -> Trajectory:
    """Start of a simulation, one sample at t = 0: [initial], or the scene's own motion. Raises TrajectoryError."""
    start = scene.initial
    if start is None:
        if scene.motion is None:
            raise TrajectoryError(f"{scene.source}: initial: missing, expected an [initial] or a [motion] table")
        return along(scene, np.zeros(1), inverse=False)
    zero = np.zeros((1, 3))
    orientation = start.orientation
    angles = np.array([orientation.angles]) if orientation else zero
    q = quaternions.of_angles(orientation.kind if orientation else "rotation_vector", (angles, zero, zero))[0]
    p = (np.array([start.position]), np.array([start.velocity]), zero)
    w = np.array([start.angular_velocity])
    return _build(scene, f"{scene.source}: initial", np.zeros(1), p, q, w, zero, inverse=False)


def from_scene(scene: Scene, samples: int = SAMPLES) -> Trajectory:
    """The scene's own motion at `samples` times, both ends included. Raises TrajectoryError."""
    return along(scene, np.linspace(0.0, scene.motion.duration if scene.motion else 0.0, samples))


def from_file(scene: Scene, path: str | Path) -> Trajectory:
    """A trajectory file: full rows (poses, twists, accelerations), or poses alone, six rows at least.

    With poses alone the rates come from quintic splines through the positions and the sign-continuous quaternion
    components, which are normalised after; ``source`` says so.

    Raises
    ------
    TrajectoryError
        Missing or unknown columns, no rows, text, values that are not finite, times that do not increase, quaternions
        that are not of length 1 within 1e-6, or a singular pose.
    """
    file = printable(path)
    names, table, lines = read_columns(Path(path))
    wanted = wanted_columns(names)
    if not len(table):
        raise TrajectoryError(f"{file}: got a header and no rows, expected at least one row")
    column = {name: table[:, j] for j, name in enumerate(names)}
    t, p, q, v, w, a, dw = (
        np.column_stack([column[name] for name in wanted[i:j]]) if j <= len(wanted) else np.empty(0)
        for i, j in ((0, 1), (1, 4), (4, 8), (8, 11), (11, 14), (14, 17), (17, 20))
    )
    t = t[:, 0]
    back = np.flatnonzero(np.diff(t) <= 0)
    if len(back):
        i = int(back[0])
        raise TrajectoryError(
            f"{file}: line {lines[i + 1]}: t: got {float(t[i + 1])!r} after {float(t[i])!r}, expected increasing times"
        )
    length = np.linalg.norm(q, axis=1)
    wrong = np.flatnonzero(np.abs(length - 1.0) > 1e-6)
    if len(wrong):
        i = int(wrong[0])
        raise TrajectoryError(
            f"{file}: line {lines[i]}: q_w, q_x, q_y, q_z: got length {length[i]:.9g}, expected 1 within 1e-6"
        )
    if wanted is not POSE:
        return _build(scene, f"{file}", t, (p, v, a), q, w, dw)
    if len(t) < SPLINE_ROWS:
        raise TrajectoryError(
            f"{file}: got {len(t)} rows of poses alone, expected at least {SPLINE_ROWS} for the spline, or the columns"
            f" {', '.join(RATES)}"
        )
    from scipy.interpolate import make_interp_spline  # half a second, for those who have poses alone

    sign = np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0)
    q = q * np.concatenate([[1.0], np.cumprod(sign)])[:, None]
    try:
        with np.errstate(all="ignore"):  # rates that overflow are refused below
            spline_p, spline_q = make_interp_spline(t, p, k=5), make_interp_spline(t, q, k=5)
            jet = quaternions.normalised((q, spline_q(t, 1), spline_q(t, 2)))
            rates = (p, spline_p(t, 1), spline_p(t, 2))
    except (np.linalg.LinAlgError, ValueError) as e:
        raise TrajectoryError(
            f"{file}: t: got steps too uneven for a quintic spline ({e}), expected even ones"
        ) from None
    wild = ~np.all([np.abs(x).max(axis=1) <= LARGEST for x in (*rates, *jet)], axis=0)
    if wild.any():
        line = lines[int(np.argmax(wild))]
        raise TrajectoryError(f"{file}: line {line}: t: got rates beyond {LARGEST:g}, expected larger time steps")
    return _build(scene, f"{file} (rates from quintic splines)", t, rates, jet[0], *quaternions.angular(jet))
