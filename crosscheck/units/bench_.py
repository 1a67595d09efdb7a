"""Speed against error of every method on the hexapod, three times over: no time is judged by a single run."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...models import load_scene
from ..bench import plan_cases
from ..run import choose_engines
from ..sweep import QUICK, TASKS, Case
from ..tolerance import ROUND_OFF
from ..unit import Key, Row, Unit, read, row

ORDER = 4
SECONDS = 300.0
"""Six times what it takes."""

REPETITIONS = 3
SCENE = "hexapod"


def units() -> list[Unit]:
    """One for each repetition."""
    command = ("bench", SCENE, "--quick")
    return [
        Unit(f"bench-{k + 1}", command, SECONDS, expected, checks, partial(times, f"bench-{k + 1}"))
        for k in range(REPETITIONS)
    ]


def _setting(backend: str, setting: str, batch: int) -> str:
    return " ".join(part for part in (backend, setting, f"batch {batch}") if part)


def _which(found: Mapping[Any, Any]) -> tuple[str, ...]:
    return tuple(str(found[name]) for name in ("task", "engine", "route", "backend", "setting", "batch"))


def expected() -> Iterable[Key]:
    """Every case of every engine."""
    cases: list[Case] = plan_cases(load_scene(SCENE), list(choose_engines([])), QUICK)
    for case in cases:
        if case.task in TASKS:
            yield Key(SCENE, case.engine, case.route, _setting(case.backend, case.setting, case.batch), case.task)


def checks(folder: Path) -> Iterable[Row]:
    """Errors: one row for each of speed_error.csv. What is exact is judged, the others' errors are what they are."""
    info = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    wrong = {_which(case): f"{case['over_tolerance']:.2g} times the tolerance" for case in info["wrong"]}
    failed = {_which(case): case["reason"] for case in info["failed"]}
    for found in read(folder / "speed_error.csv").to_dict("records"):
        which = _which(found)
        verdict = "error" if which in failed else "fail" if which in wrong else "pass"
        setting = _setting(found["backend"], found["setting"], found["batch"])
        key = Key(SCENE, found["engine"], found["route"], setting, found["task"])
        reason = failed.get(which) or wrong.get(which, "")
        yield row(key, found["max_rel_error"], np.nan, ROUND_OFF.rounding, verdict, reason=reason)


def times(unit: str, folder: Path) -> Iterable[Row]:
    """Times per sample, and over that of the yardstick; what failed has none."""
    info = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    yardstick = info["baseline"]["us_per_sample"] if info["baseline"] else np.nan
    for found in read(folder / "speed_error.csv").to_dict("records"):
        us = found["us_per_sample"]
        if np.isfinite(us):
            which = {name: found[name] for name in ("task", "scene", "engine", "route", "backend", "setting", "batch")}
            yield which | {"unit": unit, "us_per_sample": us, "yardstick_us": yardstick, "ratio": us / yardstick}
