"""What an engine is: a name, a scene to hold, and the inverse dynamics of a trajectory. Adding one is adding a file.

An engine is a class `ENGINE` in a module ``engines/NAME_.py``, or an entry point of the group
``stewart_crosscheck.engines``.  Its library is imported when an engine is made, so that a missing package is an error
of that engine alone.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, entry_points, version
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Protocol, Self, TypeGuard

import numpy as np

from ..models.reading import printable
from ..models.scene import Scene
from . import engines, wrench

if TYPE_CHECKING:
    from .checks import Worst
    from .trajectory import Trajectory

GROUP = "stewart_crosscheck.engines"
REFERENCE = "reference"

LOOPS = ("loop_pos", "loop_vel", "loop_acc")
HULL = ("F_hull", "M_hull")
PLATFORM = ("a", "alpha")

Key = tuple[str, str]
"""Engine and route of a result."""


class EngineError(RuntimeError):
    """An engine that did not give a usable answer: a warning of its own, a value that is not finite, a wrong count."""


class UnknownEngine(ValueError):
    """No engine of that name; the message lists the valid ones."""


@dataclass(frozen=True)
class ModelFacts:
    """What an engine counts in its own model.

    ``bodies`` with mass, ``massless`` ones that the format wants between two joints, ``velocities`` of the tree,
    ``rows`` of the loops, total ``mass`` [kg]; ``floors``: what is there because the format cannot do without.
    """

    bodies: int
    massless: int
    velocities: int
    rows: int
    mass: float
    floors: tuple[str, ...] = ()


class Law(NamedTuple):
    """Name of the error that an engine's own solver is known to make, and why."""

    name: str
    why: str


@dataclass(frozen=True)
class DynamicsResult:
    """What one engine says of one trajectory, world axes, SI units.

    ``samples`` (nt,): rows of the trajectory that the result holds.  ``F, L, dL`` (nt, N): driving force [N], leg
    length [m] and its rate [m/s].  ``reactions`` (nt, nj, 6): moment [N m] then force [N] on the child of each of
    ``scene.joints`` at the joint's point (M_s about the rod's centre of mass, M_n about O_n, M_o about O_o, F_r at the
    tip).  ``loops``: closure residual (nt, N, 3) at position, velocity and acceleration level, from the engine's own
    model.  ``model``: what it counts there.  Of the certified reference alone: ``radius``, proven radii of F,
    reactions, L, dL, hull, by these names, and ``hull`` (nt, 6): moment and force on the hull about the mean of its
    pins, from the rate of momentum.  Of forward dynamics alone, whose ``F`` is what was handed in: ``platform``
    (nt, 6), its acceleration and angular acceleration in world axes; ``mobility`` (nt,), condition of J M^-1 J^T;
    ``amplification``, what its solver makes of rounding beside a direct solve; and, if the solver is known not to be
    exact, its ``law`` with the errors ``predicted`` for reactions and platform, by these names and in their shapes, and
    where that prediction is ``valid`` (nt,).  ``seconds``: wall time.

    What `checks` makes of it holds the compared ``samples`` alone, and, in place of ``loops``, ``checks``: the gaps of
    the loops and the Newton-Euler balance at all samples of the trajectory; ``evaluated``: how many these are.
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
    hull: np.ndarray | None = None
    model: ModelFacts | None = None
    platform: np.ndarray | None = None
    mobility: np.ndarray | float = 1.0
    amplification: float = 1.0
    valid: np.ndarray | bool = True
    law: Law | None = None
    predicted: Mapping[str, np.ndarray] = field(default_factory=dict)
    seconds: float = float("nan")
    checks: Mapping[str, Worst] = field(default_factory=dict)
    evaluated: int = 0


@dataclass(frozen=True)
class Failure:
    """An engine that did not run, and why, on one line."""

    reason: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "reason", printable(self.reason))

    def about(self, what: str) -> Self:
        """The same, and what was asked for."""
        return replace(self, reason=f"{what}: {self.reason}")


class Died(Failure):
    """An engine whose process ended without an answer."""


class Crashed(Died):
    """One that ended by itself, was killed, or could not start."""


class Late(Died):
    """One that was ended, because it had no answer within its time limit."""


def crashed(outcomes: Iterable[tuple[str, object]]) -> list[str]:
    """Engines that crashed, sorted, from outcomes by the engine's name."""
    return sorted({name for name, outcome in outcomes if isinstance(outcome, Crashed)})


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


class ForwardEngine(Engine, Protocol):
    """An engine that also answers driving forces, on a second route."""

    forward_route: ClassVar[str]

    def forward_dynamics(self, trajectory: Trajectory, F: np.ndarray) -> DynamicsResult:
        """Platform acceleration and reactions under driving forces (nt, N) at a trajectory's poses and velocities.

        Raises EngineError. The trajectory's accelerations are what the answer is compared with.
        """
        ...


def routes(engine: type[Engine]) -> tuple[str, ...]:
    """Routes of an engine, inverse dynamics first."""
    return (engine.route, engine.forward_route) if is_forward(engine) else (engine.route,)


def is_forward(engine: type[Engine]) -> TypeGuard[type[ForwardEngine]]:
    """Whether an engine has a second route."""
    return hasattr(engine, "forward_dynamics")


def by_joint(scene: Scene, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """Reactions (nt, nj, 6) in the order of `scene.joints` from forces and moments (nt, N, 3) by name."""
    zero = np.zeros_like(values["F_r"])
    parts = [(values[j.moment] if j.moment else zero, values[j.force], j.leg - 1) for j in scene.joints]
    return np.stack([wrench.from_parts(M[:, leg], F[:, leg]) for M, F, leg in parts], axis=1)


def quantity(scene: Scene, name: str, F: np.ndarray, reactions: np.ndarray) -> np.ndarray:
    """One quantity leg by leg from driving forces and reactions: (nt, N, 1) for F, (nt, 1, 3) on the hull, else 3."""
    if name == "F":
        return F[..., None]
    part, kind = (slice(3, 6), "force") if name.startswith("F") else (slice(0, 3), "moment")
    if name in HULL:
        first = [j for j, joint in enumerate(scene.joints) if joint.parent == "hull"]
        return wrench.on_hull(reactions[:, first], np.array(scene.hull.pins))[:, None, part]
    index = [j for j, joint in enumerate(scene.joints) if getattr(joint, kind) == name]
    return reactions[:, index, part]


def platform_quantity(name: str, platform: np.ndarray) -> np.ndarray:
    """`a` or `alpha` (nt, 1, 3) from both (nt, 6)."""
    return platform[:, None, :3] if name == "a" else platform[:, None, 3:]


def values(scene: Scene, result: DynamicsResult, name: str) -> np.ndarray:
    """One quantity of a result, leg by leg as `quantity` gives it."""
    if name in PLATFORM:
        return platform_quantity(name, np.asarray(result.platform))
    return quantity(scene, name, result.F, result.reactions)


def _files() -> list[str]:
    return sorted(m.name.removesuffix("_") for m in pkgutil.iter_modules(engines.__path__) if m.name.endswith("_"))


def engine_names() -> list[str]:
    """Names of every engine: files in `engines`, then entry points under other names, the reference last."""
    plugins = sorted({e.name for e in entry_points(group=GROUP)} - set(_files()))
    return [*(name for name in _files() if name != REFERENCE), *plugins, REFERENCE]


def load_engine(name: str) -> type[Engine]:
    """Class of an engine; a built-in one cannot be replaced by an entry point. Raises UnknownEngine."""
    if name in _files():
        return importlib.import_module(f"{engines.__name__}.{name}_").ENGINE
    for plugin in entry_points(group=GROUP):
        if plugin.name == name:
            return plugin.load()
    raise UnknownEngine(f"got an unknown engine {name!r}, expected one of {', '.join(engine_names())}")


def engine_version(engine: type[Engine]) -> str | None:
    """Installed version of an engine's package, None if it is missing."""
    try:
        return version(engine.package)
    except PackageNotFoundError:
        return None


def require_finite(engine: str, **arrays: np.ndarray) -> None:
    """Raise EngineError that names the array and the sample of the first value that is not finite."""
    for name, values in arrays.items():
        with np.errstate(over="ignore", invalid="ignore"):
            if np.isfinite(values.sum()):  # ten times as fast as to look at each
                continue
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            raise EngineError(f"{engine}: {name} is not finite at sample {bad[0][0]}")


def require_complete(
    name: str, engine: type[Engine], route: str, scene: Scene, trajectory: Trajectory, result: object
) -> None:
    """Raise EngineError unless a result has everything that its engine declares, in the right shapes, all finite.

    Only the reference speaks for some of the samples, and brings radii.  `name` is the one that the engine was found
    by: what a class calls itself proves nothing.
    """
    if not isinstance(result, DynamicsResult):
        raise EngineError(f"{name}: got {type(result).__name__}, expected a DynamicsResult")
    nt, N, nj = len(trajectory.t), scene.N, len(scene.joints)
    shapes = {"F": (nt, N), "reactions": (nt, nj, 6), "L": (nt, N), "dL": (nt, N)}
    arrays = {key: getattr(result, key) for key in shapes}
    if name == REFERENCE:
        nt = len(result.samples)
        shapes = {key: (nt, *shape[1:]) for key, shape in shapes.items()}
        shapes["hull"], arrays["hull"] = (nt, 6), result.hull
        shapes |= {f"radius of {key}": shape for key, shape in shapes.items()}
        arrays |= {f"radius of {key}": value for key, value in result.radius.items()}
    elif result.radius or not np.array_equal(result.samples, np.arange(nt)):
        raise EngineError(f"{name}: only the reference brings radii or leaves samples out")
    if route == engine.route:
        wanted = [check for check in engine.checks if check in LOOPS]
        shapes |= {loop: (nt, N, 3) for loop in wanted}
        arrays |= dict(result.loops)
    else:
        shapes["platform"], arrays["platform"] = (nt, 6), result.platform
        shapes["mobility"], arrays["mobility"] = (nt,), result.mobility
        if np.ndim(result.mobility) == 0:
            arrays["mobility"] = np.full(nt, result.mobility)
        if result.law:
            shapes |= {f"law of {key}": shapes[key] for key in ("reactions", "platform")}
            arrays |= {f"law of {key}": value for key, value in result.predicted.items()}
    for key, shape in shapes.items():
        got = np.shape(arrays[key]) if key in arrays else None
        if got != shape:
            raise EngineError(
                f"{name}: {key}: got {'nothing' if got is None else f'shape {got}'}, expected shape {shape}"
            )
    require_finite(name, **{key: arrays[key] for key in shapes})
