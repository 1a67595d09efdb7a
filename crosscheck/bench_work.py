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

SLOW = 0.2
"""Seconds of a first pass from which a second one would not tell more."""


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
        self.timer = timer
        self._held: dict[Case, tuple[Ready, timeit.Timer]] = {}

    def __call__(self, case: Case, inputs: Inputs) -> tuple[Ready, timeit.Timer]:
        """Ready, with a timer of one call of all its parts. Raises EngineError."""
        if case not in self._held:
            ready = load_sweep(case.engine).ready(case, inputs)
            self._held[case] = ready, timeit.Timer(lambda: one_pass(ready), timer=self.timer)
        return self._held[case]


WARM = Warm()
"""Of an engine's process, from one task to the next."""


def one_pass(ready: Ready) -> None:
    """What a timing repeats."""
    call = ready.call
    for part in ready.parts:
        call(part)


def first(case: Case, inputs: Inputs, least: float, warm: Warm = WARM) -> First:
    """Answer a case once, and find how many calls take `least` seconds. Raises EngineError."""
    one_thread()
    ready, timer = warm(case, inputs)
    start = warm.timer()
    results = [ready.call(part) for part in ready.parts]
    seconds = warm.timer() - start
    answer = ready.read(results, picked(len(inputs.trajectory.t), case.batch))
    del results
    peak = _peak(ready) if case.task != "simulate" else 0
    if seconds < SLOW:
        seconds = timer.timeit(1)
    return First(answer, max(1, round(least / seconds)), ready.samples, peak)


def _peak(ready: Ready) -> int:
    """Memory [bytes] of one batch."""
    tracemalloc.start()
    ready.call(ready.parts[0])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def again(case: Case, inputs: Inputs, number: int, warm: Warm = WARM) -> float:
    """Seconds of so many passes. Raises EngineError.

    Others had the caches meanwhile, and the system the memory: a pass that is not timed takes both back. A simulation
    is long enough to do so itself.
    """
    one_thread()  # a process that was replaced starts with as many as there are cores
    _, timer = warm(case, inputs)
    if case.task != "simulate":
        timer.timeit(1)
    return timer.timeit(number)


def one_thread() -> None:
    """Hold the linear algebra of this process to one thread."""
    threadpool_limits(1)


def threads() -> list[dict[str, Any]]:
    """Linear algebra libraries of this process and how many threads each has."""
    one_thread()
    return [{key: info[key] for key in ("internal_api", "version", "num_threads")} for info in threadpool_info()]
