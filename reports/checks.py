"""The tables of a night: one row for each thing that was checked, one for each thing that was timed."""

from __future__ import annotations

CHECK_COLUMNS = [
    "run_id", "unit", "scene", "engine", "engine_version", "route", "setting", "quantity", "error", "tolerance",
    "floor", "margin", "verdict", "reason", "where", "reproduce",
]  # fmt: skip
"""``error``, ``tolerance`` and ``floor``, what rounding alone may be, share one unit; ``margin``: error over tolerance,
empty where nothing is promised; ``reproduce``: a command line."""

CHECK_KEY = ["unit", "scene", "engine", "route", "setting", "quantity"]
"""What a row of checks is about: no two rows of a night share it."""

TIME_COLUMNS = [
    "run_id", "unit", "task", "scene", "engine", "engine_version", "route", "backend", "setting", "batch",
    "us_per_sample", "yardstick_us", "ratio",
]  # fmt: skip
"""``unit``: the repetition; ``ratio``: the time over that of the yardstick in the same repetition."""

TIME_KEY = ["task", "scene", "engine", "route", "backend", "setting", "batch"]
"""What a time is about: every repetition of a night has one row of it."""

RANK = {
    "pass": 0, "accurate": 0, "degraded": 1, "unsupported": 2, "refused": 2, "silent": 3, "fail": 4, "error": 5,
}  # fmt: skip
"""Verdicts from the best to the worst: of comparisons (pass, unsupported, fail, error) and of hard cases."""

RED = ("fail", "error")
"""Verdicts that are red whatever they were before."""
