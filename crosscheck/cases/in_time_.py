"""Hard motions: through a singular pose, past the vertical, for long, with steps and gains that are too large."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ...models.scene import Scene, load_scene
from ..engines.reference_ import certified
from ..hard import Passage, TimeCase, decades

Vector = tuple[float, float, float]

STEP = 1e-3
"""Of the short motions [s]: what engines are used with."""

SHORT, INTERVALS = 0.1, 25
"""Duration of the short motions [s]."""


def _changed(name: str, **tables: Any) -> Scene:
    """A built-in scene with other tables and without motion; None takes a table away."""
    data = load_scene(name).model_dump(by_alias=True, exclude_none=True) | {"motion": None} | tables
    return Scene.model_validate({key: table for key, table in data.items() if table is not None})


def _constant(F: Sequence[float]) -> dict[str, Any]:
    return {"legs": [{"c0": f} for f in F]}


def _ring(radius: float, offset: float, height: float) -> list[Vector]:
    """Six pins in pairs on a circle, each pair by `offset` [rad] to both sides of its place."""
    angles = [math.radians(120.0 * k) + side * offset for k in range(3) for side in (1.0, -1.0)]
    return [(radius * math.sin(u), height, radius * math.cos(u)) for u in angles]


def _turning(speed: float) -> Passage:
    """A symmetric hexapod whose platform turns through 90 degrees, where no force of its legs holds a screw."""
    hull = _ring(0.9, math.radians(13.0), 0.0)
    pins = _ring(0.4, math.radians(47.0), 0.0)
    scene = _changed("hexapod")
    weight = sum(body.mass for body in scene.bodies) * 9.81
    push = weight / 6.0 / 0.7
    start = math.pi / 2.0 - 0.4 * speed * SHORT
    initial = {
        "position": [0.01, 0.94, -0.02],
        "orientation": {"kind": "rotation_vector", "angles": [0.0, start, 0.0]},
        "velocity": [0.05, 0.1, -0.07],
        "angular_velocity": [0.0, speed, 0.0],
    }
    platform = scene.platform.model_dump(exclude_none=True) | {"pins": pins}
    forces = _constant([push * (1.0 + 0.02 * i) for i in range(6)])
    scene = _changed("hexapod", platform=platform, hull={"pins": hull}, initial=initial, forces=forces)
    return Passage(scene, SHORT, INTERVALS, STEP, 2.0 * STEP)


def _swinging(distance: float, before: float, velocity: Vector, thin: bool) -> Passage:
    """The first leg of the hexapod near the vertical, under forces that would hold it there at rest.

    Its tip is above its hull pin but for a distance along z_r, and one along x_r `before` that.
    """
    scene = load_scene("hexapod")
    C, w, r = (0.021, 0.943, -0.017), (0.3, -0.2, 0.25), scene.pins[0]
    tip = [c + x for c, x in zip(C, r, strict=True)]
    swing = (w[1] * r[2] - w[2] * r[1], w[2] * r[0] - w[0] * r[2], w[0] * r[1] - w[1] * r[0])
    first = (tip[0] + before, scene.hull.pins[0][1], tip[2] - distance)
    tables: dict[str, Any] = {"hull": {"pins": (first, *scene.hull.pins[1:])}}
    if thin:
        leg = scene.leg.model_dump(exclude={"base"})
        leg["guide"]["J_y"] = leg["rod"]["J_z"] = 0.0
        tables["leg"] = leg
    rest = dict.fromkeys(("velocity", "angular_velocity", "acceleration", "angular_acceleration"), (0.0,) * 3)
    row = {"position": C, "quaternion": (1.0, 0.0, 0.0, 0.0), **rest}
    held = certified(_changed("hexapod", **tables), row)["F"]
    tables["initial"] = {
        "position": C,
        "orientation": {"kind": "rotation_vector", "angles": (0.0, 0.0, 0.0)},
        "velocity": [v - s for v, s in zip(velocity, swing, strict=True)],
        "angular_velocity": w,
    }
    scene = _changed("hexapod", **tables, forces=_constant([float(f) for f in held]))
    return Passage(scene, SHORT, INTERVALS, STEP, 2.0 * STEP)


def _passing(distance: float) -> Passage:
    """Past the vertical at 1 m/s, a hundredth of a second after the start.

    Without inertia about its own axis or its base's, a leg does not mind: only q_o does, which turns by half a turn.
    """
    return _swinging(distance, 0.01, (1.0, 0.15, 0.0), thin=True)


def _circling(distance: float) -> Passage:
    """Around the vertical at 10 rad/s.

    With such inertia a leg either turns away from the vertical or goes right through it, never by at a small distance.
    """
    return _swinging(distance, 0.0, (10.0 * distance, 0.15, 0.0), thin=False)


LONG_STEP = 1e-4
"""Of the long motions [s]: engines of first order are within a tenth of a leg after a hundred thousand of them."""


def _long(steps: float) -> Passage:
    return Passage(load_scene("hanging"), steps * LONG_STEP, INTERVALS, LONG_STEP, 2.0 * LONG_STEP)


def _large_step(step: float) -> Passage:
    return Passage(load_scene("hanging"), 2.0, 4, step, 0.5 * step)


GAIN_STEP = 5e-3
"""[s], with gains that are a multiple of its inverse."""


def _stiff(gain: float) -> Passage:
    """MuJoCo's time constant is the inverse of a gain, in steps; DART's reduction is what a step takes of a gap."""
    settings = {
        ("analytic", "RK4 + Baumgarte"): {"gain": gain / GAIN_STEP},
        ("mujoco", "mj_step RK4"): {"time_constant": 1.0 / gain},
        ("dart", "World.step"): {"reduction": gain},
    }
    return Passage(load_scene("hanging"), 1.0, INTERVALS, GAIN_STEP, 0.5 * GAIN_STEP, settings)


CASES = (
    TimeCase(
        "turning_through_singular", "turning through a parallel singular pose", "angular speed at the start, rad/s",
        (10.0, 3.0, 1.0, 0.3), _turning,
    ),
    TimeCase(
        "passing_vertical", "a leg without inertia about its axes swings past the vertical",
        "distance, m", decades(-1, -4), _passing,
    ),
    TimeCase(
        "circling_vertical", "a leg whose base has inertia turns about the vertical",
        "distance at the start, m", decades(-1, -4), _circling,
    ),
    TimeCase("long_motion", "a hanging platform swings for long", "steps of 1e-4 s", decades(2, 5), _long),
    TimeCase(
        "large_steps", "steps that are too large for a swinging platform", "step, s",
        (5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.25, 0.5), _large_step,
    ),
    TimeCase(
        "stiff_gains", "loops closed with gains that are too stiff", "gain times step",
        (0.01, 0.03, 0.1, 0.3, 1.0, 2.0, 2.5, 3.0, 4.0), _stiff,
    ),
)  # fmt: skip
