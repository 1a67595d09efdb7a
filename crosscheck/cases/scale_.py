"""Numbers of very different size: where the machine stands, how large and heavy its parts are, in which units."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ...models.scene import Scene
from ..hard import Case, Point, Row, decades
from .machines import BAR, DW, POINT, SPATIAL, TURNED, A, V, Vector, W, changed, plus, scaled


def _tensor(scene: Scene, k: float) -> tuple[Vector, ...]:
    return tuple(scaled(k, row) for row in scene.platform.tensor)


def _far(offset: float) -> Point:
    """Hull and platform moved together, positions rounded where they come to lie."""
    away = (0.6 * offset, 0.48 * offset, -0.64 * offset)

    pins = [plus(pin, away) for pin in changed("hexapod", {}).hull.pins]
    there = SPATIAL._replace(position=plus(SPATIAL.position, away))
    return Point(changed("hexapod", {"hull": {"pins": pins}}), there)


def _small(size: float) -> Point:
    scene = changed("hexapod", {})
    pins = [scaled(size, pin) for pin in scene.pins]
    return Point(changed(scene, {"platform": {"pins": pins, "inertia": _tensor(scene, size * size)}}), SPATIAL)


def _legs(scene: Scene, k: float) -> dict[str, Any]:
    """Masses and inertias of a leg's parts times k; the guide's centre of mass stays."""
    parts = {"base": ("mass", "J_z"), "guide": ("mass", "J_x", "J_y"), "rod": ("mass", "J_x", "J_z")}
    return {
        part: {name: k * getattr(getattr(scene.leg, part), name) for name in names}
        for part, names in parts.items()
        if getattr(scene.leg, part)
    }


def _platform(scene: Scene, k: float) -> dict[str, Any]:
    """Mass and inertia of a platform times k."""
    platform = scene.platform
    inertia = {"inertia": _tensor(scene, k)} if platform.inertia else {}
    turning = {"J_z": k * platform.J_z} if platform.J_z else {}
    return {"mass": k * platform.mass} | inertia | turning


def _ratio(name: str, row: Row) -> Callable[[float], Point]:
    """Of the platform's mass and inertia to those of the legs; what is the heavier keeps its own."""

    def at(ratio: float) -> Point:
        scene = changed(name, {})
        lighter = {"platform": _platform(scene, ratio)} if ratio < 1.0 else {"leg": _legs(scene, 1.0 / ratio)}
        return Point(changed(scene, lighter), row)

    return at


def _leg_inertia(ratio: float) -> Point:
    """Central moments of guide and rod, at their masses; those about the leg's axis may shrink, but hardly grow."""
    leg = changed("hexapod", {}).leg
    guide, rod, less = leg.guide, leg.rod, min(1.0, ratio)
    parts = {
        "guide": {"J_x": guide.mass * guide.com**2 + ratio * guide.central_J_x, "J_y": less * guide.J_y},
        "rod": {"J_x": ratio * rod.J_x, "J_z": less * rod.J_z},
    }
    return Point(changed("hexapod", {"leg": parts}), SPATIAL)


def _spin(ratio: float) -> Point:
    """Inertia about y_r and about the leg's axis; the latter may not grow beyond twice the transverse one."""
    scene = changed("hexapod", {})
    base, few = _legs(scene, ratio)["base"]["J_z"], _legs(scene, min(10.0, ratio))
    parts = {"base": {"J_z": base}, "guide": {"J_y": few["guide"]["J_y"]}, "rod": {"J_z": few["rod"]["J_z"]}}
    return Point(changed(scene, {"leg": parts}), SPATIAL)


def _light(name: str, row: Row, *parts: str) -> Callable[[float], Point]:
    """Parts of a scene that hardly weigh: masses of a scene file are positive, so that zero is no value."""

    def at(k: float) -> Point:
        scene = changed(name, {})
        leg = {part: numbers for part, numbers in _legs(scene, k).items() if part in parts}
        platform = _platform(scene, k) if "platform" in parts else {}
        return Point(changed(scene, {"leg": leg, "platform": platform}), row)

    return at


def _units(length: float = 1.0, mass: float = 1.0, time: float = 1.0) -> Point:
    """The built-in hexapod and a motion in other units: how many of them are a metre, a kilogram, a second."""
    scene = changed("hexapod", {})
    inertia, speed, turn = mass * length * length, length / time, 1.0 / time
    leg = _legs(scene, inertia)
    for part, numbers in leg.items():
        numbers["mass"] = mass * getattr(scene.leg, part).mass
    leg["guide"]["com"] = length * scene.leg.guide.com
    pins, platform_pins = ([scaled(length, pin) for pin in some] for some in (scene.hull.pins, scene.pins))
    platform = {"mass": mass * scene.platform.mass, "inertia": _tensor(scene, inertia), "pins": platform_pins}
    changes = {
        "gravity": scaled(speed / time, scene.gravity),
        "leg": leg | {"a": length * scene.leg.a},
        "platform": platform,
        "hull": {"pins": pins},
    }
    position = scaled(length, SPATIAL.position)
    twist, rates = (scaled(speed, V), scaled(turn, W)), (scaled(speed / time, A), scaled(turn / time, DW))
    return Point(changed(scene, changes), Row(position, TURNED, *twist, *rates))


RATIOS = decades(-12, 12)[::2]
LIGHT = decades(-2, -20)[::2]
UNITS = decades(-6, 6)

CASES = (
    Case("scale_offset", "Machine far from the world's origin", "distance, m", decades(-1, 8), _far),
    Case("scale_size", "Small platform", "size over the hexapod's", decades(0, -9), _small),
    Case("scale_mass", "Platform against legs", "mass ratio over the hexapod's", RATIOS, _ratio("hexapod", SPATIAL)),
    Case("scale_mass_planar", "Bar against legs", "mass ratio over planar3's", RATIOS, _ratio("planar3", BAR)),
    Case("scale_leg_inertia", "Transverse inertia of guides and rods", "over the hexapod's", RATIOS, _leg_inertia),
    Case("scale_spin", "Inertia about the legs' axes and of the bases", "over the hexapod's", RATIOS, _spin),
    *(
        Case(f"scale_light_{what}", f"{title} without mass", "mass and inertia over the scene's", LIGHT, at)
        for what, title, at in (
            ("legs", "Legs of the hexapod", _light("hexapod", SPATIAL, "base", "guide", "rod")),
            ("guides", "Guides of the hexapod", _light("hexapod", SPATIAL, "guide")),
            ("rods", "Rods of the hexapod", _light("hexapod", SPATIAL, "rod")),
            ("platform", "Platform of the hexapod", _light("hexapod", SPATIAL, "platform")),
            ("guides_planar", "Guides of a planar machine", _light("planar3", BAR, "guide")),
            ("rods_planar", "Rods of a planar machine", _light("planar3", BAR, "rod")),
            ("point", "Point mass between two legs", _light("pointmass2", POINT, "platform")),
        )
    ),
    Case("scale_length", "Unit of length", "units per metre", UNITS, lambda k: _units(length=k)),
    Case("scale_kilogram", "Unit of mass", "units per kilogram", UNITS, lambda k: _units(mass=k)),
    Case("scale_time", "Unit of time", "units per second", UNITS, lambda k: _units(time=k)),
)
