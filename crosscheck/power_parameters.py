"""Faults in the numbers of a scene: every number of the machine, and copies of the scene in which one is wrong."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from ..models.scene import Scene
from ..models.tables import Table
from .certainty import MACHINE

AXES = "xyz"

Path = tuple[str | int, ...]
"""Names of tables and fields, and places in tuples, from the scene down to a number."""


class Parameter(NamedTuple):
    """One number of a scene: the way to it, its name, and what a fault in it is a share of [its unit].

    ``share_of``: what that is, in words; ``group``: parameters that people look at together.
    """

    path: Path
    name: str
    group: str
    size: float
    share_of: str


def parameters(scene: Scene) -> list[Parameter]:
    """Every number of the machine; those below the diagonal of a symmetric tensor are those above it."""
    return [_parameter(scene, path) for path in numbers(scene) if not _below(path)]


def numbers(x: Any, path: Path = ()) -> Iterator[Path]:
    """Ways to all numbers of the machine."""
    if isinstance(x, Table):
        for name in MACHINE if isinstance(x, Scene) else type(x).model_fields:
            yield from numbers(getattr(x, name), (*path, name))
    elif isinstance(x, tuple):
        for i, part in enumerate(x):
            yield from numbers(part, (*path, i))
    elif isinstance(x, float):
        yield path


def at(x: Any, path: Path) -> Any:
    """What stands at the end of a way."""
    for step in path:
        x = x[step] if isinstance(step, int) else getattr(x, step)
    return x


def wrong(scene: Scene, parameter: Parameter, d: float) -> Scene:
    """The scene with one number off by the relative fault `d`. It is not validated: a fault need not make sense."""
    right = at(scene, parameter.path)
    new = right + math.copysign(d * parameter.size, right)
    changed = _replaced(scene, parameter.path, new)
    if "inertia" in parameter.path:
        *way, i, j = parameter.path
        changed = _replaced(changed, (*way, j, i), new)
    return changed


def _replaced(x: Any, path: Path, value: float) -> Any:
    if not path:
        return value
    step, *rest = path
    if isinstance(step, int):
        return tuple(_replaced(part, tuple(rest), value) if i == step else part for i, part in enumerate(x))
    return x.model_copy(update={step: _replaced(getattr(x, step), tuple(rest), value)})


def _below(path: Path) -> bool:
    """Whether a number stands below the diagonal of the platform's inertia."""
    return "inertia" in path and path[-2] > path[-1]  # pyright: ignore[reportOperatorIssue] # the last two are places


def _parameter(scene: Scene, path: Path) -> Parameter:
    value = abs(at(scene, path))
    size, share_of = (value, "itself") if value else _size(scene, path)
    return Parameter(path, _name(path), _group(path), size, share_of)


def _name(path: Path) -> str:
    words, places = [str(step) for step in path if isinstance(step, str)], [s for s in path if isinstance(s, int)]
    name = ".".join(words)
    if "inertia" in words:
        return f"{name}.{''.join(AXES[i] for i in places)}"
    if len(places) == 2:
        return f"{name}[{places[0] + 1}].{AXES[places[1]]}"
    return f"{name}.{AXES[places[0]]}" if places else name


def _group(path: Path) -> str:
    """`masses`, `inertias`, `platform.pins` and the like."""
    field = [step for step in path if isinstance(step, str)][-1]
    if field == "mass":
        return "masses"
    if field == "inertia" or field.startswith("J_"):
        return "inertias"
    if field in ("a", "com"):
        return "leg lengths"
    return ".".join(str(step) for step in path if isinstance(step, str))


def _size(scene: Scene, path: Path) -> tuple[float, str]:
    """What a fault in a number that is zero is a share of."""
    home = at(scene, path[:-1])
    if isinstance(home, tuple):  # a vector, or a row of the inertia
        if "inertia" in path:
            return max(abs(x) for row in scene.platform.tensor for x in row), "the largest moment of inertia"
        if own := math.hypot(*home):
            return own, "its vector's length"
    elif str(path[-1]).startswith("J_"):
        return home.J_x, "J_x of the same body"
    if path[0] == "gravity":
        return 1.0, "1 m/s^2"
    weight = sum(body.mass for body in scene.bodies) * (math.hypot(*scene.gravity) or 1.0)
    length = max(math.dist(p, q) for p in scene.hull.pins for q in scene.hull.pins) or 1.0
    sizes = {"force": (weight, "the weight"), "moment": (weight * length, "the weight times the hull's width")}
    return sizes.get(str(path[1]), (length, "the hull's width"))
