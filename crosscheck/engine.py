"""What an engine is: a name, a scene to hold, and the inverse dynamics of a trajectory. Adding one is adding a file.

An engine is a class `ENGINE` in a module ``engines/NAME_.py``, or an entry point of the group
``stewart_crosscheck.engines``.  Its library is imported when an engine is made, so that a missing package is an error
of that engine alone.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, entry_points, version
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from ..models.scene import Scene
from . import engines

if TYPE_CHECKING:
    from .trajectory import Trajectory

GROUP = "stewart_crosscheck.engines"
REFERENCE = "reference"

LOOPS = ("loop_pos", "loop_vel", "loop_acc")


class EngineError(RuntimeError):
    """An engine that did not give a usable answer: a warning of its own, a value that is not finite, a wrong count."""


class UnknownEngine(ValueError):
    """No engine of that name; the message lists the valid ones."""


@dataclass(frozen=True)
class DynamicsResult:
    """What one engine says of one trajectory, world axes, SI units.

    ``samples`` (nt,): rows of the trajectory that the result holds.  ``F, L, dL`` (nt, N): driving force [N], leg
    length [m] and its rate [m/s].  ``reactions`` (nt, nj, 6): moment [N m] then force [N] on the child of each of
    ``scene.joints`` at the joint's point (M_s about the rod's centre of mass, M_n about O_n, M_o about O_o, F_r at the
    tip).  ``loops``: closure residual (nt, N, 3) at position, velocity and acceleration level, from the engine's own
    model.  ``radius``: proven radii of F, reactions, L, dL, by these names, of the certified reference alone.
    """

    engine: str
    version: str
    route: str
    setting: str
    samples: np.ndarray
    F: np.ndarray
    reactions: np.ndarray
    L: np.ndarray
    dL: np.ndarray
    loops: Mapping[str, np.ndarray] = field(default_factory=dict)
    radius: Mapping[str, np.ndarray] = field(default_factory=dict)
    seconds: float = float("nan")


class Engine(Protocol):
    """Protocol of an engine."""

    name: ClassVar[str]
    package: ClassVar[str]
    """Distribution whose version is reported."""
    route: ClassVar[str]
    checks: ClassVar[tuple[str, ...]]
    """Quantities beside forces and moments: loop residuals of its own, Newton-Euler balance."""

    def __init__(self, scene: Scene, models: Mapping[str, str] | None = None) -> None:
        """Hold a scene. `models`: file name to text; by default what `write_models` makes of the scene."""
        ...

    def inverse_dynamics(self, trajectory: Trajectory) -> DynamicsResult:
        """Driving forces and joint reactions along a trajectory. Raises EngineError, never returns half an answer."""
        ...


def quantity(scene: Scene, name: str, F: np.ndarray, reactions: np.ndarray) -> np.ndarray:
    """One quantity leg by leg from driving forces and reactions: (nt, N, 1) for F, else (nt, N, 3)."""
    if name == "F":
        return F[..., None]
    part, kind = (slice(3, 6), "force") if name.startswith("F") else (slice(0, 3), "moment")
    index = [j for j, joint in enumerate(scene.joints) if getattr(joint, kind) == name]
    return reactions[:, index, part]


def engine_names() -> list[str]:
    """Names of every engine, reference last: files in `engines`, then entry points."""
    files = [m.name.removesuffix("_") for m in pkgutil.iter_modules(engines.__path__) if m.name.endswith("_")]
    plugins = [e.name for e in entry_points(group=GROUP) if e.name not in files]
    names = sorted(files, key=lambda n: (n == REFERENCE, n != "analytic", n)) + sorted(plugins)
    return [n for n in names if n != REFERENCE] + [REFERENCE]


def load_engine(name: str) -> type[Engine]:
    """Class of an engine. Raises UnknownEngine."""
    if name not in engine_names():
        raise UnknownEngine(f"got an unknown engine {name!r}, expected one of {', '.join(engine_names())}")
    for plugin in entry_points(group=GROUP):
        if plugin.name == name:
            return plugin.load()
    return importlib.import_module(f"{engines.__name__}.{name}_").ENGINE


def engine_version(engine: type[Engine]) -> str | None:
    """Installed version of an engine's package, None if it is missing."""
    try:
        return version(engine.package)
    except PackageNotFoundError:
        return None


def require_finite(engine: str, **arrays: np.ndarray) -> None:
    """Raise EngineError that names the array and the sample of the first value that is not finite."""
    for name, values in arrays.items():
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            raise EngineError(f"{engine}: {name} is not finite at sample {bad[0][0]}")
