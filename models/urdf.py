"""Scene to URDF and a list of loops, for Pinocchio and DART: URDF is a tree, the list closes it.

Frames as in the MJCF: joint coordinates are q_o, q_n, q_s without offsets, the rod's frame sits at its centre of mass.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Sequence

from .mjcf import numbers, to_text
from .scene import Scene

WIDE = {"lower": "-1000.0", "upper": "1000.0", "effort": "1e9", "velocity": "1e9"}
"""Limits that never bind: the format demands some."""


WORLD = "world"
"""Root link: the fixed hull. Under this name DART makes no body of it; under any other it would weigh 1 kg."""


def _link(
    robot: ET.Element, name: str, mass: float = 0.0, com: Sequence[float] = (0, 0, 0), I: Sequence[float] = (0.0,) * 6
) -> None:
    """A link; I = ixx, iyy, izz, ixy, ixz, iyz about the centre of mass. One that is no body says zero mass."""
    inertial = ET.SubElement(ET.SubElement(robot, "link", name=name), "inertial")
    ET.SubElement(inertial, "origin", xyz=numbers(com), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=repr(mass))
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    ET.SubElement(inertial, "inertia", {k: repr(float(v)) for k, v in zip(names, I, strict=True)})


def _joint(
    robot: ET.Element, name: str, kind: str, parent: str, child: str, axis: str = "", xyz: Sequence[float] = (0, 0, 0)
) -> None:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=numbers(xyz), rpy="0 0 0")
    if axis:
        ET.SubElement(joint, "axis", xyz=axis)
    if kind in ("revolute", "prismatic"):
        ET.SubElement(joint, "limit", WIDE)


def write_urdf(scene: Scene) -> str:
    """URDF text of a scene's tree, the platform on a floating joint. Gravity and load are no part of the format."""
    robot = ET.Element("robot", name=scene.name)
    ET.SubElement(robot, "link", name=WORLD)
    for i in scene.legs:
        _leg(robot, scene, i)
    _platform(robot, scene)
    return to_text(robot)


def _leg(robot: ET.Element, scene: Scene, i: int) -> None:
    base, guide, rod = scene.leg.base, scene.leg.guide, scene.leg.rod
    pin, planar = scene.hull.pins[i - 1], scene.topology == "planar"
    J_x = guide.central_J_x
    # In a plane nothing turns about the long axis of guide and rod, and equal moments do, as they do for a base.
    J_n, J_s = (J_x, rod.J_x) if planar else (guide.J_y, rod.J_z)
    if planar:
        first, xyz = WORLD, pin
    else:
        # A universal joint is two revolute ones, and URDF wants a link between them.
        first, xyz = (f"base{i}" if base else f"cross{i}"), (0, 0, 0)
        if base:
            _link(robot, first, base.mass, I=(base.J_z, base.J_z, base.J_z, 0.0, 0.0, 0.0))
        else:
            _link(robot, first)
        _joint(robot, f"o{i}", "revolute", WORLD, first, "0 1 0", pin)
    _link(robot, f"guide{i}", guide.mass, (0, guide.com, 0), (J_x, J_n, J_x, 0.0, 0.0, 0.0))
    _joint(robot, f"n{i}", "revolute", first, f"guide{i}", "0 0 1", xyz)
    _link(robot, f"rod{i}", rod.mass, I=(rod.J_x, J_s, rod.J_x, 0.0, 0.0, 0.0))
    _joint(robot, f"s{i}", "prismatic", f"guide{i}", f"rod{i}", "0 1 0")


def _platform(robot: ET.Element, scene: Scene) -> None:
    """A floating joint; in a plane a planar one, for a point mass two prismatic ones with a link between them."""
    I, mass, parent = scene.platform.tensor, scene.platform.mass, WORLD
    if scene.freedom == "point":
        _link(robot, "cart")
        _joint(robot, "platform_x", "prismatic", WORLD, "cart", "1 0 0")
        parent = "cart"
    turning = (scene.platform.J_z or 0.0,) * 3 if scene.topology == "planar" else (I[0][0], I[1][1], I[2][2])
    _link(robot, "platform", mass, I=(*turning, I[0][1], I[0][2], I[1][2]))
    if scene.freedom == "point":
        _joint(robot, "platform_y", "prismatic", parent, "platform", "0 1 0")
    elif scene.freedom == "planar":
        _joint(robot, "platform", "planar", parent, "platform", "0 0 1")
    else:
        _joint(robot, "platform", "floating", parent, "platform")


def write_loops(scene: Scene) -> str:
    """Loop list (JSON) beside the URDF: per spherical joint, or planar pin, a point [m] of rod and platform."""
    loops = [
        {
            "name": f"r{i}",
            "type": closure.type,
            "child": {"link": f"rod{i}", "point": [0.0, scene.leg.a, 0.0]},
            "parent": {"link": "platform", "point": list(p)},
        }
        for i, p, closure in zip(scene.legs, scene.pins, (j for j in scene.joints if j.cut), strict=True)
    ]
    return json.dumps({"robot": scene.name, "gravity": list(scene.gravity), "loops": loops}, indent=2) + "\n"
