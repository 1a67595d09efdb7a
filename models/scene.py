"""Scenes: one TOML file describes one mechanism, its bodies, joints, motion and load. Everything is checked on load."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, PrivateAttr, StringConstraints, ValidationError, model_validator

from ..analytic import stewart
from .explain import explain, show
from .reading import printable, read_text, read_toml
from .tables import Hull, Initial, LegForces, LegTable, LoadTable, Motion, Platform, Table, Vector
from .topology import require_topology

MOST_BYTES = 1_000_000
"""Of a scene file: the built-in ones have some two thousand."""

Freedom = Literal["spatial", "planar", "point"]


class SceneError(ValueError):
    """A scene that cannot be used: the message names the file and the field, what was got and what is expected."""


class Body(NamedTuple):
    """A moving body: its name and mass [kg]."""

    name: str
    mass: float


class Joint(NamedTuple):
    """A joint with a reaction.

    `cut`: a loop closure; `coordinates`: its hinges and slides in the tree, one velocity each; `force`, `moment`: the
    quantities that name its reaction on the child (None: that component is zero).
    """

    name: str
    leg: int
    parent: str
    child: str
    type: Literal["revolute", "universal", "prismatic", "spherical"]
    coordinates: tuple[str, ...]
    actuated: bool
    cut: bool
    force: str
    moment: str | None


@cache
def _joints(N: int, topology: str, bases: bool) -> tuple[Joint, ...]:
    """All that `Scene.joints` depends on; what asks for one sample at a time asks for them each time."""
    joints: list[Joint] = []
    for i in range(1, N + 1):
        o, n, s, r = f"o{i}", f"n{i}", f"s{i}", f"r{i}"
        base, guide, rod = f"base{i}", f"guide{i}", f"rod{i}"
        if topology == "planar":
            joints.append(Joint(n, i, "hull", guide, "revolute", (n,), False, False, "F_n", "M_n"))
        elif not bases:
            joints.append(Joint(n, i, "hull", guide, "universal", (o, n), False, False, "F_n", "M_n"))
        else:
            joints.append(Joint(o, i, "hull", base, "revolute", (o,), False, False, "F_o", "M_o"))
            joints.append(Joint(n, i, base, guide, "revolute", (n,), False, False, "F_n", "M_n"))
        joints.append(Joint(s, i, guide, rod, "prismatic", (s,), True, False, "F_s", "M_s"))
        closure = "revolute" if topology == "planar" else "spherical"
        joints.append(Joint(r, i, "platform", rod, closure, (), False, True, "F_r", None))
    return tuple(joints)


class Scene(Table):
    """A validated scene. Bodies and joints are listed by what the file holds: nothing else is modelled."""

    schema_: Annotated[Literal[1], Field(alias="schema")]
    name: Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]
    topology: Literal["spatial", "planar"]
    gravity: Vector = (0.0, -9.81, 0.0)
    leg: LegTable
    platform: Platform
    hull: Hull
    motion: Motion | None = None
    load: LoadTable | None = None
    initial: Initial | None = None
    forces: LegForces | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Scene:
        require_topology(self)
        if self.platform.pins and len(self.platform.pins) != self.N:
            raise ValueError(
                f"platform.pins has {len(self.platform.pins)} rows, hull.pins {self.N}: one pin per leg is needed"
            )
        if self.forces and len(self.forces.legs) != self.N:
            raise ValueError(f"forces.legs has {len(self.forces.legs)} rows, expected one per leg: {self.N}")
        return self

    _source: str = PrivateAttr("")
    _sha256: str = PrivateAttr("")

    @property
    def source(self) -> str:
        """The file it came from, for error messages."""
        return self._source or self.name

    @property
    def sha256(self) -> str:
        """Digest of the file's text."""
        return self._sha256 or hashlib.sha256(self.model_dump_json(by_alias=True).encode()).hexdigest()

    @property
    def N(self) -> int:
        """Number of legs."""
        return len(self.hull.pins)

    @property
    def bodies(self) -> tuple[Body, ...]:
        """Moving bodies: per leg base (if the scene has one), guide, rod; then the platform."""
        leg = [("base", self.leg.base), ("guide", self.leg.guide), ("rod", self.leg.rod)]
        legs = [Body(f"{kind}{i}", part.mass) for i in self.legs for kind, part in leg if part is not None]
        return (*legs, Body("platform", self.platform.mass))

    @property
    def joints(self) -> tuple[Joint, ...]:
        """Joints that carry a reaction, leg by leg from hull to platform. The platform's own freedom is none."""
        return _joints(self.N, self.topology, self.leg.base is not None)

    @property
    def legs(self) -> range:
        """Leg numbers, from 1."""
        return range(1, self.N + 1)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the legs' joint coordinates, leg by leg: o1, n1, s1, o2, ..."""
        return tuple(c for joint in self.joints for c in joint.coordinates)

    @property
    def hull_coordinates(self) -> tuple[str, ...]:
        """Name of each leg's first coordinate, whose axis goes through the hull pin."""
        return tuple(j.coordinates[0] for j in self.joints if j.parent == "hull")

    @property
    def freedom(self) -> Freedom:
        """How the platform moves: in space, as a rigid body in the plane x_r y_r, or as a point there."""
        if self.topology == "spatial":
            return "spatial"
        return "point" if self.platform.J_z is None else "planar"

    @property
    def pins(self) -> tuple[Vector, ...]:
        """Platform pins, one per leg [m, platform axes]; all of them in its centre for a point mass."""
        return self.platform.pins or ((0.0, 0.0, 0.0),) * self.N

    @property
    def loop_axes(self) -> tuple[int, ...]:
        """World axes along which a spherical joint, or a pin of a planar mechanism, holds its two bodies together."""
        return (0, 1, 2) if self.topology == "spatial" else (0, 1)

    @property
    def platform_equations(self) -> int:
        """Velocities of the platform, and equations that it gives for the driving forces."""
        return {"spatial": 6, "planar": 3, "point": 2}[self.freedom]

    @property
    def platform_coordinates(self) -> tuple[str, ...]:
        """Names of a planar platform's own coordinates: C_p along x_r and y_r, angle about z_r. None in space."""
        return ("platform_x", "platform_y", "platform_turn")[: {"spatial": 0, "planar": 3, "point": 2}[self.freedom]]

    @property
    def nv(self) -> int:
        """Velocities of the tree: the legs' coordinates and the platform's."""
        return len(self.coordinates) + self.platform_equations

    @property
    def na(self) -> int:
        """Actuators."""
        return sum(joint.actuated for joint in self.joints)

    @property
    def nc(self) -> int:
        """Closure equations: three per spherical joint, two per pin of a planar mechanism."""
        return len(self.loop_axes) * sum(joint.cut for joint in self.joints)

    @property
    def quantities(self) -> tuple[str, ...]:
        """Forces and moments that the scene has, in the paper's order: F, F_r, F_s, F_n, F_o, M_s, M_n, M_o."""
        forces = ["F", *dict.fromkeys(j.force for j in reversed(self.joints))]
        return (*forces, *dict.fromkeys(j.moment for j in reversed(self.joints) if j.moment))

    @property
    def parameters(self) -> stewart.Parameters | stewart.PlanarParameters:
        """The same numbers as the formulas name them."""
        base, guide, rod = self.leg.base, self.leg.guide, self.leg.rod
        leg = stewart.Leg(
            m_n=guide.mass, a_n=guide.com, J_nx=guide.J_x, J_ny=guide.J_y,
            m_s=rod.mass, a=self.leg.a, J_sx=rod.J_x, J_sz=rod.J_z,
            m_o=base.mass if base else 0.0, J_oz=base.J_z if base else 0.0,
        )  # fmt: skip
        load = stewart.Load(self.load.force, self.load.moment, self.load.point) if self.load else stewart.Load()
        common = (self.pins, self.hull.pins, self.gravity, load)
        if self.topology == "planar":
            return stewart.PlanarParameters(leg, self.platform.mass, self.platform.J_z, *common)
        return stewart.Parameters(leg, self.platform.mass, self.platform.tensor, *common)


def _require_schema(data: dict[str, Any], source: str) -> None:
    schema = data.get("schema", 1)
    if type(schema) is not int or schema != 1:  # by type: True and 1.0 are equal to 1
        raise SceneError(f"{source}: schema: got {show(schema)}, expected 1")


def parse_scene(text: str, source: str) -> Scene:
    """Scene from TOML text; `source` names it in errors. Raises SceneError."""
    try:
        data = read_toml(text)
    except ValueError as e:
        raise SceneError(f"{source}: got no TOML, expected a scene: {e}") from None
    if not data:
        raise SceneError(f"{source}: got an empty file, expected a scene (schema = 1, name, topology, [leg], ...)")
    _require_schema(data, source)
    try:
        scene = Scene.model_validate(data)
    except ValidationError as e:
        raise SceneError("\n".join(f"{source}: {line}" for line in explain(e))) from None
    scene._source, scene._sha256 = source, hashlib.sha256(text.encode()).hexdigest()
    return scene


def _folder() -> Traversable:
    return resources.files(__name__.rpartition(".")[0]) / "scenes"


def scene_names() -> list[str]:
    """Names of the built-in scenes: the TOML files beside this module."""
    folder = _folder()
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load_scene(name_or_path: str | Path) -> Scene:
    """Load a built-in scene by name, or any scene by the path of its TOML file.

    Raises
    ------
    SceneError
        Unknown name, unreadable file, broken TOML, or values that describe no mechanism.
    """
    name = printable(name_or_path)
    if name in scene_names():
        text = (_folder() / f"{name}.toml").read_text(encoding="utf-8")
        return parse_scene(text, f"{name}.toml")
    path = Path(name_or_path)
    try:
        looks_like_path = name and (path.suffix == ".toml" or len(path.parts) > 1 or path.exists())
        if not looks_like_path:
            raise SceneError(
                f"{name!r}: got an unknown scene, expected one of {', '.join(scene_names())} or a TOML file"
            )
        text = read_text(path, MOST_BYTES)
    except SceneError:
        raise
    except OSError as e:
        raise SceneError(f"{name}: {e.strerror or e}, expected a readable TOML file") from None
    except ValueError as e:  # too much, no text, or a path with a null byte
        raise SceneError(f"{name}: {e}, expected a readable TOML file in UTF-8 of at most 1 MB") from None
    return parse_scene(text, name)
