"""Nights made by hand, as small as a test needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pandas as pd

from stewart_crosscheck.reports import Night, night_files, night_of, write_files
from stewart_crosscheck.reports.checks import CHECK_COLUMNS, TIME_COLUMNS

VERSIONS = {"python": "3.11.9", "numpy": "2.4.0", "mujoco": "4.0.0", "pin": "4.1.0", "stewart-crosscheck": "0.1.0"}
ENGINES = {"mujoco": "4.0.0", "pinocchio": "4.1.0", "analytic": "0.1.0"}
CODE = {"commit": "0123456789abcdef", "sha256": "c0de" * 16}
MACHINE = {"processor": "x86_64", "model": "A processor", "usable_cores": 2}
FIRST = datetime(2026, 11, 1, 3, 0, tzinfo=UTC)


def check(**facts: Any) -> dict[str, Any]:
    """A row of checks that passes: 1e-12, a hundredth of the tolerance, a thousand times the floor."""
    row: dict[str, Any] = {
        "unit": "run-hexapod", "scene": "hexapod", "engine": "mujoco", "route": "kkt", "setting": "", "quantity": "F",
        "error": 1e-12, "tolerance": 1e-10, "floor": 1e-15, "verdict": "pass", "reason": "", "where": "leg 1",
        "reproduce": "crosscheck run hexapod --engine mujoco",
    } | facts  # fmt: skip
    versions = {"engine_version": ENGINES.get(row["engine"], "")}
    return versions | {"margin": row["error"] / row["tolerance"]} | row


def time(unit: str, ratio: float, **facts: Any) -> dict[str, Any]:
    """A row of times, in one repetition."""
    return {
        "unit": unit, "task": "driving_forces", "scene": "hexapod", "engine": "mujoco", "engine_version": "4.0.0",
        "route": "kkt", "backend": "", "setting": "", "batch": 1, "us_per_sample": 10.0 * ratio, "yardstick_us": 10.0,
        "ratio": ratio,
    } | facts  # fmt: skip


def times(*ratios: float, **facts: Any) -> list[dict[str, Any]]:
    """A row for each repetition."""
    return [time(f"bench-{k}", ratio, **facts) for k, ratio in enumerate(ratios, 1)]


def files(
    day: int = 0,
    checks: Sequence[Mapping[str, Any]] = (),
    times: Sequence[Mapping[str, Any]] = (),
    more: Mapping[str, str] | None = None,
    **facts: Any,
) -> dict[str, str]:
    """The files of the night of a day; the facts replace those of run.json."""
    started = FIRST + timedelta(days=day)
    run_id = f"{started:%Y%m%dT%H%M%SZ}-nightly-{day:04x}"
    units = dict.fromkeys([*(row["unit"] for row in checks), *(row["unit"] for row in times)])
    info = {
        "kind": "nightly", "run_id": run_id, "started": started.isoformat(), "versions": VERSIONS, "code": CODE,
        "machine": MACHINE, "units": {name: {"seconds": 1.5, "attempts": 1} for name in units},
    } | facts  # fmt: skip
    checked = pd.DataFrame([{"run_id": info["run_id"], **row} for row in checks], columns=CHECK_COLUMNS)
    timed = pd.DataFrame([{"run_id": info["run_id"], **row} for row in times], columns=TIME_COLUMNS)
    return night_files(checked, timed, info, more or {})


def night(day: int = 0, *checks: Mapping[str, Any], **facts: Any) -> Night:
    """The night of a day, as if it had been read."""
    return night_of(Path(f"night-{day}"), files(day, checks, **facts))


def write(history: Path, day: int = 0, *checks: Mapping[str, Any], **facts: Any) -> Path:
    """The night of a day in a folder of its own."""
    texts = files(day, checks, **facts)
    folder = history / f"{FIRST + timedelta(days=day):%Y%m%dT%H%M%SZ}-nightly-{day:04x}"
    write_files(folder, texts)
    return folder
