"""What a spatial scene needs, and what a planar one must not have: every rule names the field."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from .tables import Component

if TYPE_CHECKING:
    from .scene import Scene


def require_topology(scene: Scene) -> None:
    """Raise ValueError that names the first field which the scene's topology lacks or cannot have."""
    rules = _spatial(scene) if scene.topology == "spatial" else _planar(scene)
    for problem in rules:
        raise ValueError(problem)


def _missing(fields: dict[str, Any], kind: str) -> Iterator[str]:
    for field, value in fields.items():
        if value is None:
            yield f"{field}: got nothing, expected this key: {kind} needs it"


def _unwanted(fields: dict[str, Any], kind: str) -> Iterator[str]:
    for field, value in fields.items():
        if value is not None:
            yield f"{field}: got a value, expected no such key: {kind} has none"


def _orientations(scene: Scene) -> dict[str, Any]:
    return {
        f"{table}.orientation": part.orientation
        for table, part in (("motion", scene.motion), ("initial", scene.initial))
        if part
    }


def _spatial(scene: Scene) -> Iterator[str]:
    leg, platform = scene.leg, scene.platform
    yield from _missing(
        {
            "leg.guide.J_y": leg.guide.J_y if "J_y" in leg.guide.model_fields_set else None,
            "leg.rod.J_z": leg.rod.J_z if "J_z" in leg.rod.model_fields_set else None,
            "platform.inertia": platform.inertia,
            "platform.pins": platform.pins,
            **_orientations(scene),
        },
        "a spatial scene",
    )
    yield from _unwanted({"platform.J_z": platform.J_z}, "a spatial scene (its inertia is `inertia`)")


def _planar(scene: Scene) -> Iterator[str]:
    platform, load = scene.platform, scene.load
    yield from _unwanted({"leg.base": scene.leg.base}, "a planar scene")
    yield from _unwanted({"platform.inertia": platform.inertia}, "a planar scene (`platform.J_z` replaces it)")
    if platform.J_z is None:
        kind = "a point mass, a planar platform without `J_z`,"
        yield from _unwanted({"platform.pins": platform.pins, **_orientations(scene)}, kind)
    else:
        yield from _missing({"platform.pins": platform.pins, **_orientations(scene)}, "a planar platform with `J_z`")
    point = platform.J_z is None
    zero = {"gravity": (scene.gravity, (2,)), "hull.pins": (scene.hull.pins, (2,))}
    if platform.pins:
        zero["platform.pins"] = (platform.pins, (2,))
    if load:
        zero["load.force"] = (load.force, (2,))
        zero["load.moment"] = (load.moment, (0, 1, 2) if point else (0, 1))
        zero["load.point"] = (load.point, (0, 1, 2) if point else (2,))
    if scene.motion:
        zero["motion.position"] = (scene.motion.position, (2,))
        if scene.motion.orientation:
            zero["motion.orientation.components"] = (scene.motion.orientation.components, (0, 1))
    if initial := scene.initial:
        zero["initial.position"], zero["initial.velocity"] = (initial.position, (2,)), (initial.velocity, (2,))
        zero["initial.angular_velocity"] = (initial.angular_velocity, (0, 1, 2) if point else (0, 1))
        if initial.orientation:
            zero["initial.orientation.angles"] = (initial.orientation.angles, (0, 1))
    kind = "a point mass" if point else "a planar scene"
    for field, (values, axes) in zero.items():
        rows = values if field.endswith(".pins") else (values,)
        for number, row in enumerate(rows):
            name = f"{field}[{number}]" if field.endswith(".pins") else field
            for axis in axes:
                value = row[axis]
                if not (value.is_zero if isinstance(value, Component) else value == 0.0):
                    got = "a component that is not zero" if isinstance(value, Component) else value
                    yield f"{name}[{axis}]: got {got}, expected 0: {kind} moves in x_r y_r and carries nothing else"
