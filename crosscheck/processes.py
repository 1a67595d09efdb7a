"""Engines side by side, each in a process of its own with a time limit: one that crashes stops nobody else."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import re
import resource
import signal
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from pebble import ProcessExpired, ProcessPool

from ..models.scene import Scene
from .checks import inverse_dynamics
from .engine import (
    REFERENCE,
    Crashed,
    DynamicsResult,
    Engine,
    EngineError,
    Failure,
    Key,
    Late,
    is_forward,
    load_engine,
    require_complete,
)
from .limited import end_with, held
from .ranges import out_of_range
from .trajectory import Trajectory

T = TypeVar("T")
K = TypeVar("K")

MOST = 200
"""Letters of what a library says that a reason repeats: of a wrong argument some print every number."""

SECONDS, SECONDS_PER_SAMPLE = 60.0, 0.05
"""Time limit of one engine: some hundred times what the slowest needs here."""


def _end_with_parent() -> None:
    """What a worker does first."""
    if (parent := multiprocessing.parent_process()) and parent.pid:
        end_with(parent.pid)


def failure_of(e: BaseException) -> Failure:
    """What something that was raised in an engine's process says."""
    if not isinstance(e, MemoryError):
        return Failure(_short(f"{type(e).__name__}: {e}"))
    limits = [resource.getrlimit(which)[0] for which in (resource.RLIMIT_DATA, resource.RLIMIT_AS)]
    limits = [f" (its limit is {limit / 1e9:.3g} GB)" for limit in sorted(limits) if limit != resource.RLIM_INFINITY]
    return Failure(f"out of memory{''.join(limits[:1])}" + (f": {e}" if str(e) else ""))


def _short(text: str) -> str:
    """The text in one line, its beginning if it is long."""
    line = " ".join(text.split())
    return line if len(line) <= MOST else f"{line[:MOST]} ..."


@contextlib.contextmanager
def _output_to(path: str) -> Iterator[None]:
    """Send what C++ libraries print to a file, for the report of a failure."""
    with open(path, "wb") as log:
        for descriptor in (1, 2):
            os.dup2(log.fileno(), descriptor)
        yield


def _work(log: str, task: Callable[..., T], args: tuple) -> T | Failure:
    """Body of a worker process."""
    with _output_to(log):
        try:
            return task(*args)
        except ImportError as e:
            return Failure(f"missing package: {e}")
        except EngineError as e:
            return Failure(" ".join(str(e).split()))
        except BaseException as e:  # whatever an engine's library raises, SystemExit too, is that engine's failure
            return failure_of(e)


def dynamics(name: str, scene: Scene, models: Mapping[str, str], motion: Path, F: np.ndarray | None) -> DynamicsResult:
    """A task: inverse dynamics along a `shared` trajectory, or forward dynamics under driving forces."""
    engine = load_engine(name)
    with open(motion, "rb") as file:
        trajectory: Trajectory = pickle.load(file)
    if F is None and name != REFERENCE:
        return inverse_dynamics(name, engine, scene, models, trajectory)
    if F is None:  # it chooses its samples itself
        route, result = engine.route, engine(scene, models).inverse_dynamics(trajectory)
    else:
        assert is_forward(engine)
        route, result = engine.forward_route, engine(scene, models).forward_dynamics(trajectory, F)
    require_complete(name, engine, route, scene, trajectory, result)
    return result


def death(exitcode: int | None, log: str) -> str:
    """How a process ended that sent no answer, and what it said last, unless it was killed from outside."""
    if exitcode == -signal.SIGKILL:
        return "its process was killed by SIGKILL (by someone, or for want of memory)"
    try:
        text = re.sub(r"\x1b\[[0-9;]*m", "", Path(log).read_text(errors="replace"))
    except OSError:
        text = ""
    last = f"; it last printed: {text.strip().splitlines()[-1][:200]}" if text.strip() else ""
    number = -(exitcode or 0)
    how = signal.Signals(number).name if number in set(signal.Signals) else f"exit code {exitcode}"
    return f"its process died: {how}{last}"


def _not_started(e: RuntimeError) -> Crashed:
    """An engine without a process, and why."""
    return Crashed(f"its process could not be started, or died at once: {e.__cause__ or e}")


class Workers(Generic[K]):
    """A process for each engine, which does one task after another; one that dies or is late is replaced."""

    def __init__(self, engines: Iterable[str], limit: float) -> None:
        # A spawned process shares nothing with this one. One pool each: no worker is shared or started in vain.
        spawn = multiprocessing.get_context("spawn")
        self._pools = {name: ProcessPool(1, initializer=_end_with_parent, context=spawn) for name in engines}
        self._limit = limit
        self._running: dict[Any, tuple[K, str, str]] = {}
        self._refused: list[tuple[K, Failure]] = []
        self._count = 0

    def __enter__(self) -> Workers[K]:
        self._folder = tempfile.TemporaryDirectory(prefix="crosscheck-")
        return self

    def __exit__(self, *exception: object) -> None:
        for pool in self._pools.values():
            pool.stop()  # also what still runs after an interrupt
        for pool in self._pools.values():  # each takes a tenth of a second to notice, all at once
            pool.join()
        self._folder.cleanup()

    def shared(self, value: object) -> Path:
        """A file with a value for several tasks: sent to each, a long trajectory would lie in memory as often."""
        self._count += 1
        path = Path(self._folder.name) / str(self._count)
        with open(path, "wb") as file:
            pickle.dump(value, file)
        return path

    def start(self, engine: str, key: K, task: Callable[..., Any], *args: Any) -> None:
        """Give an engine's process a task whose outcome `ended` tells under `key`."""
        self._count += 1
        log = str(Path(self._folder.name) / str(self._count))
        try:
            resource_tracker.ensure_running()  # by itself it would do that in between, and let signals through
            with held(signal.SIGINT):  # a terminal sends it to all: this process ends the others
                future = self._pools[engine].schedule(_work, args=(log, task, args), timeout=self._limit)
            self._running[future] = key, engine, log
        except RuntimeError as e:  # no process could be started before, and none will
            self._refused.append((key, _not_started(e)))

    def ended(self) -> Iterator[tuple[K, Any]]:
        """Keys and outcomes, Failure among them, as tasks end; more of them may be started meanwhile."""
        while self._running or self._refused:
            while self._refused:
                yield self._refused.pop(0)
            for future in wait(self._running, return_when=FIRST_COMPLETED).done if self._running else ():
                key, engine, log = self._running.pop(future)
                outcome = self._outcome(future, log)
                if isinstance(outcome, Failure) and (why := out_of_range(load_engine(engine))):
                    outcome = replace(outcome, reason=f"{outcome.reason} ({why})")
                yield key, outcome

    def _outcome(self, future: Future, log: str) -> object:
        try:
            return future.result()
        except TimeoutError:
            return Late(f"no answer within {self._limit:.0f} s")
        except ProcessExpired as e:
            return Crashed(death(e.exitcode, log))
        except BrokenProcessPool as e:
            return _not_started(e)
        except Exception as e:  # a result that cannot be sent back
            return failure_of(e)


def run_engines(
    engines: Mapping[str, type[Engine]],
    scene: Scene,
    models: Mapping[str, str],
    trajectory: Trajectory,
    done: Callable[[str, str, DynamicsResult | Failure], None] = lambda name, route, result: None,
) -> dict[Key, DynamicsResult | Failure]:
    """Results by engine and route; `done` is called as each of them ends.

    Forward dynamics gets the driving forces of the certified reference, at its samples, once it has ended.
    """
    results: dict[Key, DynamicsResult | Failure] = {}

    def end(key: Key, result: DynamicsResult | Failure) -> None:
        results[key] = result
        done(*key, result)

    def start_forward(workers: Workers[Key], truth: DynamicsResult | Failure) -> None:
        keys = [(name, engine.forward_route) for name, engine in engines.items() if is_forward(engine)]
        if not isinstance(truth, DynamicsResult):
            for key in keys:
                end(key, Failure("no certified driving forces"))
            return
        motion = workers.shared(trajectory.at(truth.samples).without_accelerations())
        for key in keys:
            workers.start(key[0], key, dynamics, key[0], scene, models, motion, truth.F)

    with Workers[Key](engines, SECONDS + SECONDS_PER_SAMPLE * len(trajectory.t)) as workers:
        motion = workers.shared(trajectory)
        for name in sorted(engines, key=lambda name: name != REFERENCE):  # others wait for its driving forces
            workers.start(name, (name, engines[name].route), dynamics, name, scene, models, motion, None)
        if REFERENCE not in engines:
            start_forward(workers, Failure(""))
        for key, result in workers.ended():
            if isinstance(result, DynamicsResult) and key[1] != engines[key[0]].route:
                truth = results[REFERENCE, engines[REFERENCE].route]
                assert isinstance(truth, DynamicsResult)
                result = replace(result, samples=truth.samples)
            end(key, result)
            if key[0] == REFERENCE:
                start_forward(workers, result)
    return results
