"""What an engine's process does for `bench`: make a case ready, answer once, and be timed, now and again."""

from __future__ import annotations

import timeit
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Any

from threadpoolctl import threadpool_info, threadpool_limits

from .sweep import Case, Inputs, Ready, load_sweep, picked


@dataclass(frozen=True)
class First:
    """A case's first visit: what it answers, and how many passes of so many samples a timing has from here on.

    ``peak``: memory [bytes] that one batch takes beyond what it is given, results included.
    """

    answer: Any
    number: int
    samples: int
    peak: int


class Warm:
    """Cases of this process that are ready, with their timers."""

    def __init__(self, timer: Callable[[], float] = perf_counter) -> None:
        self._timer = timer
        self._held: dict[Case, tuple[Ready, timeit.Timer]] = {}

    def __call__(self, case: Case, inputs: Inputs) -> tuple[Ready, timeit.Timer]:
        """Ready, with a timer of one call of all its parts. Raises EngineError."""
        if case not in self._held:
            ready = load_sweep(case.engine).ready(case, inputs)
            self._held[case] = ready, timeit.Timer(lambda: _pass(ready), timer=self._timer)
        return self._held[case]


_warm = Warm()


def _pass(ready: Ready) -> None:
    call = ready.call
    for part in ready.parts:
        call(part)


def first(case: Case, inputs: Inputs, least: float, warm: Warm = _warm) -> First:
    """Answer a case once, and find how many calls take `least` seconds. Raises EngineError."""
    one_thread()
    ready, timer = warm(case, inputs)
    results = [ready.call(part) for part in ready.parts]
    answer = ready.read(results, picked(len(inputs.trajectory.t), case.batch))
    del results
    number, peak = 1, 0
    if case.task != "simulate":  # which takes so long that one call is a timing
        peak = _peak(ready)
        number, seconds = timer.autorange()
        number = max(1, round(number * least / seconds))
    return First(answer, number, ready.samples, peak)


def _peak(ready: Ready) -> int:
    """Memory [bytes] of one batch."""
    tracemalloc.start()
    ready.call(ready.parts[0])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def again(case: Case, inputs: Inputs, number: int, warm: Warm = _warm) -> float:
    """Seconds of so many passes. Raises EngineError."""
    one_thread()  # a process that was replaced starts with as many as there are cores
    _, timer = warm(case, inputs)
    return timer.timeit(number)


def one_thread() -> None:
    """Hold the linear algebra of this process to one thread."""
    threadpool_limits(1)


def threads() -> list[dict[str, Any]]:
    """Linear algebra libraries of this process and how many threads each has."""
    one_thread()
    return [{key: info[key] for key in ("internal_api", "version", "num_threads")} for info in threadpool_info()]
