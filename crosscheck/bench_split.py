"""Where an engine's time goes: inside its library, or in what carries numbers to it and from it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import pandas as pd

from .bench_work import WARM, Warm, one_pass, one_thread
from .clock import watching
from .engine import Failure
from .sweep import MANY, TASKS, Case, Inputs, Plan

SPLIT_COLUMNS = ["engine", "task", "route", "setting", "us_per_sample", "engine_share", "call", "call_us"]


PASSES = 3
"""Of which the shortest counts, watched and unwatched: what disturbs them only adds."""


class Split(NamedTuple):
    """Time of a pass [s per sample], and that of each call into the engine's library by name."""

    wall: float
    calls: dict[str, float]


def split(case: Case, inputs: Inputs, warm: Warm = WARM) -> Split | None:
    """Watch a case; None if it has no engine to watch. Raises EngineError."""
    one_thread()
    ready, timer = warm(case, inputs)
    if ready.engine is None:
        return None
    wall = min(timer.repeat(PASSES, 1))  # unwatched: reading clocks takes time, too
    watched = []
    for _ in range(PASSES):
        with watching(ready.engine) as spent:
            one_pass(ready)
        watched.append(spent)
    spent = min(watched, key=lambda calls: sum(calls.values()))
    return Split(wall / ready.samples, {name: seconds / ready.samples for name, seconds in spent.items()})


def split_cases(cases: Sequence[Case], plan: Plan) -> list[Case]:
    """One case of each engine, task and route, the most accurate one, many samples at a time."""
    many = min(MANY, plan.engine_batches[-1])
    return list({case[:3]: case for case in cases if case.task in TASKS[:3] and case.batch == many}.values())


def split_table(found: dict[Case, Split | Failure | None]) -> pd.DataFrame:
    """A row for each case that could be watched; `call` is the one that costs most."""
    rows = []
    for case, result in found.items():
        if isinstance(result, Split):
            call, longest = max(result.calls.items(), key=lambda item: item[1])
            share = sum(result.calls.values()) / result.wall
            which = (case.engine, case.task, case.route, case.setting)
            rows.append((*which, result.wall * 1e6, share, call, longest * 1e6))
    return pd.DataFrame(rows, columns=SPLIT_COLUMNS)
