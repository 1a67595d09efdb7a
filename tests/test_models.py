"""Model files: current, minimal, and holding the scene's numbers when an engine has read them."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Callable
from importlib import resources
from typing import Any, NamedTuple

import numpy as np
import pytest
from machines import random_scene

from stewart_crosscheck.crosscheck.engine import load_engine
from stewart_crosscheck.crosscheck.trajectory import from_scene
from stewart_crosscheck.models import Scene, load_scene, scene_names, write_loops, write_mjcf, write_models, write_urdf

GENERATED = resources.files("stewart_crosscheck.models") / "generated"

only_mujoco = pytest.mark.parametrize("engine_name", ["mujoco"], indirect=True)


@pytest.fixture(scope="module")
def without_base(hexapod: Scene) -> Scene:
    return hexapod.model_copy(update={"leg": hexapod.leg.model_copy(update={"base": None})})


class Rigid(NamedTuple):
    """Mass, centre of mass in the body's axes, inertia about it."""

    mass: float
    com: np.ndarray
    inertia: np.ndarray


# --- The files that people open ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", scene_names())
def test_generated_files_are_current(name: str) -> None:
    how = f"refresh: `crosscheck models {name} --out DIR`, then copy DIR/* to models/generated"
    for file, text in write_models(load_scene(name)).items():
        assert (GENERATED / file).is_file(), f"models/generated/{file} is missing; {how}"
        assert (GENERATED / file).read_text(encoding="utf-8") == text, f"models/generated/{file} is out of date; {how}"


def test_generated_holds_no_other_files() -> None:
    wanted = {file for name in scene_names() for file in write_models(load_scene(name))}
    assert {entry.name for entry in GENERATED.iterdir()} == wanted


def test_a_changed_scene_gives_changed_files(hexapod: Scene) -> None:
    """One unit in the last place of a mass shows: the comparison above can fail."""
    mass = float(np.nextafter(hexapod.platform.mass, np.inf))
    changed = hexapod.model_copy(update={"platform": hexapod.platform.model_copy(update={"mass": mass})})
    for file in ("hexapod.xml", "hexapod.urdf"):
        assert write_models(changed)[file] != (GENERATED / file).read_text(encoding="utf-8")


# --- The text ---------------------------------------------------------------------------------------------------------


def test_mjcf_holds_bodies_joints_and_closures_only(hexapod: Scene) -> None:
    root = ET.fromstring(write_mjcf(hexapod))
    tags = [element.tag for element in root.iter()]
    assert {tag: tags.count(tag) for tag in set(tags)} == {
        "mujoco": 1, "compiler": 1, "option": 1, "flag": 1, "worldbody": 1, "equality": 1, "actuator": 1,
        "body": 19, "inertial": 19, "joint": 18, "freejoint": 1, "site": 12, "connect": 6, "motor": 6,
    }  # fmt: skip


def test_urdf_has_19_links_beside_world_each_with_one_joint(hexapod: Scene) -> None:
    root = ET.fromstring(write_urdf(hexapod))
    links = [link.attrib["name"] for link in root.iter("link")]
    assert links == ["world", *(body.name for body in hexapod.bodies)]
    assert len(links) == 20
    assert sorted(child.attrib["link"] for child in root.iter("child")) == sorted(links[1:])
    types = [joint.attrib["type"] for joint in root.iter("joint")]
    assert {t: types.count(t) for t in set(types)} == {"revolute": 12, "prismatic": 6, "floating": 1}


def test_without_base_mjcf_has_13_bodies_and_urdf_6_massless_carriers(without_base: Scene) -> None:
    names = {body.name for body in without_base.bodies}
    assert len(names) == 13
    assert {body.attrib["name"] for body in ET.fromstring(write_mjcf(without_base)).iter("body")} == names
    masses = {
        link.attrib["name"]: float(mass.attrib["value"])
        for link in ET.fromstring(write_urdf(without_base)).iter("link")
        if (mass := link.find("inertial/mass")) is not None
    }
    assert {name for name, mass in masses.items() if mass > 0} == names
    assert {name for name, mass in masses.items() if mass == 0} == {f"cross{i}" for i in without_base.legs}


def _attribute(root: ET.Element, path: str, attribute: str) -> list[float]:
    element = root.find(path)
    assert element is not None, path
    return [float(x) for x in element.attrib[attribute].split()]


@pytest.mark.parametrize("seed", range(3))
def test_numbers_in_the_text_are_the_same_float64(seed: int) -> None:
    """Random numbers use all 53 bits; `==`, no tolerance."""
    scene = random_scene(seed, gravity=(0.1, -9.81, 1.0 / 3.0))
    leg, platform = scene.leg, scene.platform
    assert leg.base is not None
    J_x, I = leg.guide.central_J_x, platform.tensor
    mjcf, urdf, loops = (
        ET.fromstring(write_mjcf(scene)),
        ET.fromstring(write_urdf(scene)),
        json.loads(write_loops(scene)),
    )
    assert _attribute(mjcf, "option", "gravity") == list(scene.gravity) == loops["gravity"]
    for i, (p, O) in enumerate(zip(scene.pins, scene.hull.pins, strict=True), start=1):
        assert _attribute(mjcf, f".//body[@name='base{i}']", "pos") == list(O)
        assert _attribute(urdf, f"joint[@name='o{i}']/origin", "xyz") == list(O)
        assert (
            _attribute(mjcf, f".//site[@name='pin{i}']", "pos") == list(p) == loops["loops"][i - 1]["parent"]["point"]
        )
        tip = _attribute(mjcf, f".//site[@name='tip{i}']", "pos")
        assert tip == [0.0, leg.a, 0.0] == loops["loops"][i - 1]["child"]["point"]
        for name, mass, com, moments in (
            (f"base{i}", leg.base.mass, 0.0, [leg.base.J_z] * 3),
            (f"guide{i}", leg.guide.mass, leg.guide.com, [J_x, leg.guide.J_y, J_x]),
            (f"rod{i}", leg.rod.mass, 0.0, [leg.rod.J_x, leg.rod.J_z, leg.rod.J_x]),
        ):
            inertial, link = f".//body[@name='{name}']/inertial", f"link[@name='{name}']/inertial"
            assert _attribute(mjcf, inertial, "mass") == [mass] == _attribute(urdf, f"{link}/mass", "value")
            assert _attribute(mjcf, inertial, "pos") == [0.0, com, 0.0] == _attribute(urdf, f"{link}/origin", "xyz")
            assert _attribute(mjcf, inertial, "diaginertia") == moments
            assert [_attribute(urdf, f"{link}/inertia", k)[0] for k in ("ixx", "iyy", "izz")] == moments
    full = [I[0][0], I[1][1], I[2][2], I[0][1], I[0][2], I[1][2]]
    assert _attribute(mjcf, ".//body[@name='platform']/inertial", "fullinertia") == full
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    assert [_attribute(urdf, "link[@name='platform']/inertial/inertia", k)[0] for k in names] == full
    assert _attribute(mjcf, ".//body[@name='platform']/inertial", "mass") == [platform.mass]
    assert _attribute(urdf, "link[@name='platform']/inertial/mass", "value") == [platform.mass]


# --- What an engine has read ------------------------------------------------------------------------------------------


def _in_mujoco(engine: Any) -> dict[str, Rigid]:
    def rigid(body: Any) -> Rigid:
        R = np.empty(9)
        engine.mj.mju_quat2Mat(R, body.iquat)
        R = R.reshape(3, 3)  # principal axes in body axes
        return Rigid(float(body.mass[0]), body.ipos.copy(), R @ np.diag(body.inertia) @ R.T)

    m = engine.model
    return {m.body(i).name: rigid(m.body(i)) for i in range(1, m.nbody)}


def _in_pinocchio(engine: Any) -> dict[str, Rigid]:
    """A joint carries one body each; massless carriers are no bodies."""
    child = {j.coordinates[-1]: j.child for j in engine.scene.joints if j.coordinates} | {"platform": "platform"}
    inertias = dict(zip(engine.model.names, engine.model.inertias, strict=True))
    massless = {name for name, inertia in inertias.items() if inertia.mass == 0}
    assert massless.isdisjoint(child)
    return {child[n]: Rigid(I.mass, I.lever, I.inertia) for n, I in inertias.items() if n not in massless}


def _in_dart(engine: Any) -> dict[str, Rigid]:
    nodes = [engine.skeleton.getBodyNode(i) for i in range(engine.skeleton.getNumBodyNodes())]
    return {
        n.getName(): Rigid(n.getMass(), n.getLocalCOM(), n.getInertia().getMoment()) for n in nodes if n.getMass() > 0
    }


READ: dict[str, Callable[[Any], dict[str, Rigid]]] = {
    "mujoco": _in_mujoco,
    "pinocchio": _in_pinocchio,
    "dart": _in_dart,
}


def compare(scene: Scene, bodies: dict[str, Rigid]) -> None:
    """Every body of the scene, and no other, with the scene's numbers.

    1e-14: inertias that MuJoCo has diagonalised and we put together again, a few units in the last place of the largest
    moment; the other numbers are copied.
    """
    leg, P = scene.leg, scene.platform
    J_x = leg.guide.J_x - leg.guide.mass * leg.guide.com * leg.guide.com  # Steiner: the file's is about O_n
    assert set(bodies) == {body.name for body in scene.bodies}
    for name, body in bodies.items():
        kind = name.rstrip("0123456789")
        com = [0.0, leg.guide.com if kind == "guide" else 0.0, 0.0]
        np.testing.assert_allclose(body.com, com, rtol=1e-14, atol=0, err_msg=f"{name}: centre of mass")
        if kind == "base":
            assert leg.base is not None
            mass, inertia, got = leg.base.mass, leg.base.J_z, body.inertia[1, 1]  # its other moments never act
        else:
            mass, inertia = {
                "guide": (leg.guide.mass, np.diag([J_x, leg.guide.J_y, J_x])),
                "rod": (leg.rod.mass, np.diag([leg.rod.J_x, leg.rod.J_z, leg.rod.J_x])),
                "platform": (P.mass, np.array(P.inertia)),
            }[kind]
            got = body.inertia
        assert body.mass == mass, f"{name}: mass"
        largest = np.abs(inertia).max()
        np.testing.assert_allclose(got, inertia, rtol=0, atol=1e-14 * largest, err_msg=f"{name}: inertia")


def test_every_body_has_the_scenes_mass_centre_and_inertia(hexapod: Scene, engine_name: str) -> None:
    engine = load_engine(engine_name)(hexapod)
    bodies = READ[engine_name](engine)
    assert len(bodies) == 19
    compare(hexapod, bodies)
    # 1e-14: 19 masses are added
    assert sum(b.mass for b in bodies.values()) == pytest.approx(6 * (2.1 + 3.4 + 2.8) + 27.3, rel=1e-14)


def test_without_base_every_engine_has_13_bodies_and_the_same_mass(without_base: Scene, engine_name: str) -> None:
    bodies = READ[engine_name](load_engine(engine_name)(without_base))
    assert len(bodies) == 13
    compare(without_base, bodies)
    # 1e-14: 13 masses are added
    assert sum(b.mass for b in bodies.values()) == pytest.approx(6 * (3.4 + 2.8) + 27.3, rel=1e-14)


@pytest.mark.parametrize(
    ("part", "key"),
    [
        ("base", "mass"), ("base", "J_z"), ("guide", "mass"), ("guide", "com"), ("guide", "J_x"), ("guide", "J_y"),
        ("rod", "mass"), ("rod", "J_x"), ("rod", "J_z"), ("platform", "mass"), ("platform", "inertia"),
    ],
)  # fmt: skip
def test_a_number_off_by_1e_12_is_seen(hexapod: Scene, engine_name: str, part: str, key: str) -> None:
    """`compare` fails for a model of a scene whose number is another."""
    table: Any = hexapod.platform if part == "platform" else getattr(hexapod.leg, part)
    value = getattr(table, key)
    if key == "inertia":
        off = ((value[0][0], value[0][1], value[0][2] + 1e-12), value[1], (value[2][0] + 1e-12, *value[2][1:]))
    else:
        off = value * (1 + 1e-12)
    table = table.model_copy(update={key: off})
    update = {"platform": table} if part == "platform" else {"leg": hexapod.leg.model_copy(update={part: table})}
    bodies = READ[engine_name](load_engine(engine_name)(hexapod.model_copy(update=update)))
    with pytest.raises(AssertionError):
        compare(hexapod, bodies)


@only_mujoco
def test_mujoco_compiles_19_bodies_24_velocities_6_closures_and_nothing_to_collide(
    hexapod: Scene, engine_name: str
) -> None:
    engine: Any = load_engine(engine_name)(hexapod)
    m = engine.model
    assert (m.nbody - 1, m.nv, m.nu, m.neq) == (19, 24, 6, 6)
    assert (m.ngeom, m.npair, m.nexclude, m.ntendon, m.nmesh) == (0, 0, 0, 0, 0)
    assert not m.dof_damping.any()
    assert not m.dof_frictionloss.any()
    assert not m.dof_armature.any()
    assert not m.jnt_limited.any()
    assert not m.jnt_stiffness.any()
    np.testing.assert_array_equal(m.opt.gravity, hexapod.gravity)


@only_mujoco
def test_mujoco_makes_18_equality_rows_and_no_other(hexapod: Scene, engine_name: str) -> None:
    engine: Any = load_engine(engine_name)(hexapod)
    engine.data.qpos = engine.state(from_scene(hexapod, 1)).q[0]
    engine.mj.mj_forward(engine.model, engine.data)
    assert engine.data.ncon == 0
    assert (engine.data.ne, engine.data.nefc) == (18, 18)
    gaps = np.abs(engine.data.efc_pos)
    assert gaps.max() < 1e-14  # m: the closures join the tips to the pins they belong to; legs are 1 m long
