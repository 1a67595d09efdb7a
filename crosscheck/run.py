"""One run: engines on one scene along one trajectory, compared with the certified truth."""

from __future__ import annotations

import hashlib
import platform
import secrets
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from ..models import write_models
from ..models.scene import Scene, SceneError
from . import compare
from .chosen import SEED
from .compare import ERROR, FAIL
from .engine import (
    REFERENCE,
    DynamicsResult,
    Engine,
    Failure,
    Key,
    UnknownEngine,
    crashed,
    engine_names,
    engine_version,
    load_engine,
    routes,
)
from .machine import machine
from .processes import run_engines
from .samples import samples
from .tolerance import ROUND_OFF, of_forces
from .trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd

AGREE, DISAGREE, ENGINE_FAILED = 0, 1, 3
"""Exit statuses of a comparison."""


def status_of(verdicts: Iterable[str]) -> int:
    """0 all agree, 1 a disagreement, 3 an engine failed to run and the others agree."""
    found = set(verdicts)
    return DISAGREE if FAIL in found else ENGINE_FAILED if ERROR in found else AGREE


@dataclass(frozen=True)
class Report:
    """What a run found: the agreement table, results by engine and route, and what goes into run.json."""

    scene: Scene
    trajectory: Trajectory
    agreement: pd.DataFrame
    results: dict[Key, DynamicsResult | Failure]
    info: dict

    @property
    def status(self) -> int:
        """As `status_of` its verdicts."""
        return status_of(self.agreement["verdict"])

    def samples(self) -> Iterator[pd.DataFrame]:
        """Blocks of the table of every number."""
        return samples(self.scene, self.trajectory, self.results)


def choose_engines(names: Sequence[str]) -> dict[str, type[Engine] | Failure]:
    """Engines by name (all if none is named), the reference always among them and last. Raises UnknownEngine."""
    unknown = [name for name in names if name not in engine_names()]
    if unknown:
        raise UnknownEngine(
            f"--engine: got an unknown engine {unknown[0]!r}, expected one of {', '.join(engine_names())}"
        )
    chosen = [*dict.fromkeys(n for n in names or engine_names() if n != REFERENCE), REFERENCE]
    engines: dict[str, type[Engine] | Failure] = {}
    for name in chosen:
        try:
            engines[name] = load_engine(name)
        except ImportError as e:
            engines[name] = Failure(f"missing package: {e}")
        except Exception as e:  # a plug-in that cannot even be imported is that engine's failure
            engines[name] = Failure(f"{type(e).__name__}: {e}")
    return engines


def require_determinate(scene: Scene) -> None:
    """Raise SceneError unless the tree's velocities are the actuators plus the closure equations."""
    if scene.nv != scene.na + scene.nc:
        equations = scene.platform_equations
        kind = "under" if scene.N > equations else "over"
        source = {"spatial": "(7), (8)", "planar": "(32)", "point": "(35)"}[scene.freedom]
        raise SceneError(
            f"{scene.source}: hull.pins: got {scene.N} legs, expected {equations}:"
            f" nv = {scene.nv}, na + nc = {scene.na} + {scene.nc};"
            f" {source}, {equations} equations for {scene.N} driving forces, leave them {kind}determined"
        )


def new_run_id(name: str, started: datetime | None = None) -> str:
    """Name of a folder of results: time in UTC, what was run, and something that no other run has."""
    return f"{started or datetime.now(UTC):%Y%m%dT%H%M%SZ}-{name}-{secrets.token_hex(2)}"


def run(
    scene: Scene,
    trajectory: Trajectory,
    engines: Sequence[str] = (),
    done: Callable[[str, str, DynamicsResult | Failure], None] = lambda name, route, result: None,
) -> Report:
    """Compare engines with the certified truth.

    Parameters
    ----------
    scene, trajectory
        From `load_scene`, and `from_scene` or `from_file`.
    engines : names; none means all. The reference always runs.
    done : called with name, route and result as each engine ends, on each of its routes.

    Raises
    ------
    UnknownEngine, SceneError
        Unusable input. An engine's own failure is no exception: it becomes `error` rows.
    """
    chosen = choose_engines(engines)
    require_determinate(scene)
    started, start = datetime.now(UTC), perf_counter()
    run_id = new_run_id(scene.name, started)
    able: dict[str, type[Engine]] = {}
    for name, engine in chosen.items():
        if isinstance(engine, Failure):
            done(name, "", engine)
        else:
            able[name] = engine
    found = run_engines(able, scene, write_models(scene), trajectory, done)
    results: dict[Key, DynamicsResult | Failure] = {}
    for name, engine in chosen.items():
        if isinstance(engine, Failure):
            results[name, ""] = engine
        else:
            results |= {(name, route): found[name, route] for route in routes(engine)}
    table = compare.agreement(run_id, scene, trajectory, chosen, results)
    wider = of_forces(trajectory.condition, trajectory.sin_q_n, trajectory.reach)
    info = {
        **provenance(run_id, started, scene, chosen),
        "seconds": perf_counter() - start,
        "trajectory": {
            "source": trajectory.source,
            "samples": len(trajectory.t),
            "rows_sha256": _sha256(
                trajectory.t.tobytes(), *(np.ascontiguousarray(x).tobytes() for x in trajectory.motion)
            ),
            "max_condition": float(trajectory.condition.max()),
            "min_sin_q_n": float(trajectory.sin_q_n.min()),
            "max_reach": float(trajectory.reach.max()),
            "undetermined": _undetermined(scene, trajectory),
            "wider_samples": int((wider > 1.0).sum()),
            "widest_tolerance": float(wider.max() * ROUND_OFF.value),
            "max_acceleration": float(np.linalg.norm(trajectory.acceleration, axis=1).max()),
            "max_angular_acceleration": float(np.linalg.norm(trajectory.angular_acceleration, axis=1).max()),
        },
        "truth": _truth(compare.truth_of(results), len(trajectory.t)),
        "models": {n: asdict(r.model) for (n, _), r in results.items() if isinstance(r, DynamicsResult) and r.model},
        "failed": _failed(results),
        "crashed": crashed((name, r) for (name, _), r in results.items()),
    }
    report = Report(scene, trajectory, table, results, info)
    info["status"] = report.status
    return report


def provenance(
    run_id: str, started: datetime, scene: Scene | None, engines: Mapping[str, type[Engine] | Failure]
) -> dict:
    """What was run where, with which versions; on one scene, if it was one."""
    return {
        "run_id": run_id,
        "started": started.isoformat(),
        "command": sys.argv,
        "versions": versions(engines),
        "machine": machine(),
        **({"scene": {"name": scene.name, "sha256": scene.sha256}} if scene else {}),
    }


def _undetermined(scene: Scene, trajectory: Trajectory) -> str:
    """What the driving forces of a singular motion mean; empty if all are determined."""
    count = int(trajectory.undetermined.sum())
    if not count:
        return ""
    free, held = "a third one", "two combinations of the three driving forces"
    if scene.N == 2:  # they push along one line, against each other if they point towards each other
        first = int(np.argmax(trajectory.undetermined))
        apart = [trajectory.position[first] - np.array(pin) for pin in scene.hull.pins]
        free, held = ("F_1 + F_2", "F_1 - F_2") if apart[0] @ apart[1] < 0 else ("F_1 - F_2", "F_1 + F_2")
    return (
        f"singular at {count} of {len(trajectory.t)} samples, rank {scene.nv - 1} of {scene.nv}: the motion determines"
        f" {held}, not {free}; compared are the shortest driving forces of that motion"
    )


def _failed(results: dict[Key, DynamicsResult | Failure]) -> dict[str, dict[str, str]]:
    """Reasons by engine and route."""
    failed: dict[str, dict[str, str]] = {}
    for (name, route), result in results.items():
        if isinstance(result, Failure):
            failed.setdefault(name, {})[route] = result.reason
    return failed


def _truth(result: DynamicsResult | Failure, nt: int) -> dict:
    if isinstance(result, Failure):
        return {"samples": 0, "of": nt}
    return {"samples": len(result.samples), "of": nt, "seed": SEED}


def versions(engines: Mapping[str, type[Engine] | Failure]) -> dict[str, str | None]:
    """Versions of Python and of the packages that results hang on."""
    packages = ("stewart-crosscheck", "numpy", "scipy", "pandas")
    found: dict[str, str | None] = {"python": platform.python_version()}
    found |= {name: version(name) for name in packages}
    return found | {e.package: engine_version(e) for e in engines.values() if not isinstance(e, Failure)}


def _sha256(*parts: bytes) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part)
    return digest.hexdigest()
