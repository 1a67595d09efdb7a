"""Scene to MJCF, for MuJoCo: explicit inertias, no geoms, no contacts, loops closed by `connect` between sites.

Frames: a leg's bodies sit at O_oi; base axes x_o, y_r, z_n, guide and rod axes x_n, y_n, z_n, so that the joint
coordinates are q_o, q_n, q_s without offsets.  The rod's frame sits at its centre of mass.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable

from .scene import Scene


def numbers(values: Iterable[float]) -> str:
    """Numbers for an attribute, each with the digits that give the same float64 back."""
    return " ".join(repr(float(v)) for v in values)


def to_text(root: ET.Element) -> str:
    """Indented XML."""
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


FLOOR = 1e-15
"""Smallest moment of inertia that MuJoCo compiles [kg m^2]; stands where a scene says less."""


def _inertial(body: ET.Element, mass: float, com: Iterable[float], **inertia: Iterable[float]) -> None:
    moments = {kind: numbers(v if kind == "fullinertia" else (max(x, FLOOR) for x in v)) for kind, v in inertia.items()}
    ET.SubElement(body, "inertial", {"mass": repr(mass), "pos": numbers(com), **moments})


def _leg(world: ET.Element, scene: Scene, i: int) -> None:
    base, guide, rod = scene.leg.base, scene.leg.guide, scene.leg.rod
    pin = numbers(scene.hull.pins[i - 1])
    parent, pos = world, pin
    planar = scene.topology == "planar"
    if base is not None:
        parent = ET.SubElement(world, "body", name=f"base{i}", pos=pin)
        # Only J_z about the hinge moves; a body needs the other two, and equal ones are always possible.
        _inertial(parent, base.mass, (0, 0, 0), diaginertia=(base.J_z,) * 3)
        ET.SubElement(parent, "joint", name=f"o{i}", type="hinge", axis="0 1 0")
        pos = "0 0 0"
    body = ET.SubElement(parent, "body", name=f"guide{i}", pos=pos)
    # In a plane nothing turns about the long axis of guide and rod: again, equal moments do.
    J_x = guide.central_J_x
    _inertial(body, guide.mass, (0, guide.com, 0), diaginertia=(J_x, J_x if planar else guide.J_y, J_x))
    if base is None and not planar:
        ET.SubElement(body, "joint", name=f"o{i}", type="hinge", axis="0 1 0")
    ET.SubElement(body, "joint", name=f"n{i}", type="hinge", axis="0 0 1")
    body = ET.SubElement(body, "body", name=f"rod{i}")
    _inertial(body, rod.mass, (0, 0, 0), diaginertia=(rod.J_x, rod.J_x if planar else rod.J_z, rod.J_x))
    ET.SubElement(body, "joint", name=f"s{i}", type="slide", axis="0 1 0")
    ET.SubElement(body, "site", name=f"tip{i}", pos=numbers((0, scene.leg.a, 0)))


def _platform(body: ET.Element, scene: Scene) -> None:
    """Inertia and freedom of the platform: six of a free joint, or one joint per coordinate in the plane."""
    I, mass = scene.platform.inertia, scene.platform.mass
    if I is not None:
        _inertial(body, mass, (0, 0, 0), fullinertia=(I[0][0], I[1][1], I[2][2], I[0][1], I[0][2], I[1][2]))
        ET.SubElement(body, "freejoint", name="platform")
        return
    _inertial(body, mass, (0, 0, 0), diaginertia=(scene.platform.J_z or 0.0,) * 3)
    kinds = (("slide", "1 0 0"), ("slide", "0 1 0"), ("hinge", "0 0 1"))
    for name, (kind, axis) in zip(scene.platform_coordinates, kinds, strict=False):
        ET.SubElement(body, "joint", name=name, type=kind, axis=axis)


def write_mjcf(scene: Scene) -> str:
    """MJCF text of a scene. The load is no part of it: the format has none."""
    root = ET.Element("mujoco", model=scene.name)
    ET.SubElement(root, "compiler", angle="radian", inertiafromgeom="false")
    option = ET.SubElement(root, "option", gravity=numbers(scene.gravity), jacobian="dense")
    ET.SubElement(option, "flag", contact="disable")
    world = ET.SubElement(root, "worldbody")
    for i in scene.legs:
        _leg(world, scene, i)
    platform = ET.SubElement(world, "body", name="platform")
    _platform(platform, scene)
    equality = ET.SubElement(root, "equality")
    actuator = ET.SubElement(root, "actuator")
    for i, p in zip(scene.legs, scene.pins, strict=True):
        ET.SubElement(platform, "site", name=f"pin{i}", pos=numbers(p))
        ET.SubElement(equality, "connect", name=f"r{i}", site1=f"tip{i}", site2=f"pin{i}")
        ET.SubElement(actuator, "motor", name=f"F{i}", joint=f"s{i}")
    return to_text(root)
