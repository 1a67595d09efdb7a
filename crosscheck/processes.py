"""Engines side by side, each in a process of its own with a time limit: one that crashes stops nobody else."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import re
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, as_completed
from pathlib import Path
from typing import Any

from pebble import ProcessExpired, ProcessPool

from ..models.scene import Scene
from .engine import DynamicsResult, EngineError, Failure, load_engine, require_complete
from .trajectory import Trajectory

SECONDS, SECONDS_PER_SAMPLE = 60.0, 0.05
"""Time limit of one engine: some hundred times what the slowest needs here."""


@contextlib.contextmanager
def _output_to(path: str) -> Iterator[None]:
    """Send what C++ libraries print to a file, for the report of a failure."""
    with open(path, "wb") as log:
        for descriptor in (1, 2):
            os.dup2(log.fileno(), descriptor)
        yield


def _work(
    name: str, scene: Scene, models: Mapping[str, str], trajectory: Trajectory, log: str
) -> DynamicsResult | Failure:
    """Body of a worker process."""
    with _output_to(log):
        try:
            engine = load_engine(name)
            result = engine(scene, models).inverse_dynamics(trajectory)
            require_complete(name, engine, scene, trajectory, result)
            return result
        except ImportError as e:
            return Failure(f"missing package: {e}")
        except EngineError as e:
            return Failure(str(e))
        except Exception as e:  # whatever an engine's library raises is that engine's failure
            return Failure(f"{type(e).__name__}: {e}")


@contextlib.contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Processes started here ignore Ctrl-C, which a terminal sends to all: this process gets it and ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals belong to the main thread
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _death(exitcode: int | None, log: str) -> str:
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


def _outcome(future: Future, log: str, limit: float) -> DynamicsResult | Failure:
    try:
        return future.result()
    except TimeoutError:
        return Failure(f"no answer within {limit:.0f} s")
    except ProcessExpired as e:
        return Failure(_death(e.exitcode, log))
    except Exception as e:  # a result that cannot be sent back
        return Failure(f"{type(e).__name__}: {e}")


def run_engines(
    names: list[str],
    scene: Scene,
    models: Mapping[str, str],
    trajectory: Trajectory,
    done: Callable[[str, DynamicsResult | Failure], None] = lambda name, result: None,
) -> dict[str, DynamicsResult | Failure]:
    """Results by name, in the order of `names`; `done` is called as each engine ends."""
    limit = SECONDS + SECONDS_PER_SAMPLE * len(trajectory.t)
    results: dict[str, DynamicsResult | Failure] = {}
    # A spawned process shares nothing with this one. One pool each: no worker is used twice or started in vain.
    spawn = multiprocessing.get_context("spawn")
    pools = {name: ProcessPool(max_workers=1, context=spawn) for name in names}
    try:
        with tempfile.TemporaryDirectory(prefix="crosscheck-") as folder:
            logs = {name: str(Path(folder) / name) for name in names}
            with _interrupts_ignored():
                futures: dict[Any, str] = {
                    pool.schedule(_work, args=(name, scene, models, trajectory, logs[name]), timeout=limit): name
                    for name, pool in pools.items()
                }
            for future in as_completed(futures):
                name = futures[future]
                results[name] = _outcome(future, logs[name], limit)
                done(name, results[name])
    finally:
        for pool in pools.values():
            pool.stop()  # also what still runs after an interrupt
            pool.join()
    return {name: results[name] for name in names}
