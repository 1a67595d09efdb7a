"""What became slower: robust statistics over repetitions, never one sample.

A time is taken over that of a yardstick in the same repetition, on a log scale. It moved if the repetitions of the two
sides do not overlap, and their shift (Hodges and Lehmann: the median of all differences) is beyond a factor and beyond
the noise. Repetitions of one night share its conditions, so their spread alone says too little about another night: the
noise of a row is never taken below that of the shifts of all rows, half of which, wherever they lie, are taken to be
nothing but noise. The bound holds for all rows of a night together.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from math import comb, exp, log, sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .checks import TIME_KEY
from .findings import GONE, NEW, SEVERITIES, Finding
from .history import Night, processor

if TYPE_CHECKING:
    import pandas as pd

LEAST = 3
"""Repetitions on either side, below which nothing is said."""

FACTORS = {"fail": 2.0, "warn": 1.25}

FALSE_ALARM = 0.01
"""Chance that noise alone moves any of the rows of a night."""

Key = tuple[str, ...]
Times = dict[Key, list[float]]


class Shift(NamedTuple):
    """How far a time moved: its factor, and whether that is beyond overlap and noise."""

    factor: float
    before: int
    after: int
    sure: bool

    @property
    def severity(self) -> str | None:
        """Of a slower time; None where nothing is to be told."""
        return next((s for s, factor in FACTORS.items() if self.sure and self.factor >= factor), None)

    @property
    def p(self) -> float:
        """Chance that samples of one distribution come apart like this (Mann and Whitney, exact)."""
        return 1.0 / comb(self.before + self.after, self.before)


def logs(nights: Iterable[Night]) -> Times:
    """Logarithms of the ratios of every time, one for each repetition."""
    found: Times = {}
    for night in nights:
        rows = night.times[night.times["ratio"] > 0.0]
        for key, ratio in zip(zip(*(rows[name] for name in TIME_KEY), strict=True), rows["ratio"], strict=True):
            found.setdefault(key, []).append(log(ratio))
    return found


def shifts(before: Times, after: Times) -> dict[Key, Shift]:
    """How far each time moved that has repetitions enough on both sides."""
    from scipy import stats  # a second, which no other command need wait for

    pairs = {
        key: (np.array(before[key]), np.array(y))
        for key, y in after.items()
        if len(y) >= LEAST and len(before.get(key, ())) >= LEAST
    }
    if not pairs:
        return {}
    shift = {key: float(np.median(np.subtract.outer(y, x))) for key, (x, y) in pairs.items()}
    ordered, half = np.sort(list(shift.values())), (len(pairs) - 1) // 2
    typical = float((ordered[half:] - ordered[: len(pairs) - half]).min()) / 2.0 / stats.norm.isf(0.25)
    sizes = {key: (len(x), len(y)) for key, (x, y) in pairs.items()}
    bound = stats.norm.isf(FALSE_ALARM / 2.0 / len(pairs))
    own_bounds = np.maximum(bound, stats.t.isf(FALSE_ALARM / 2.0, np.array(list(sizes.values())).sum(axis=1) - 2))
    moved = {}
    for (key, (x, y)), own_bound in zip(pairs.items(), own_bounds, strict=True):
        n, m = sizes[key]
        own = sqrt((x.var() * n + y.var() * m) / (n + m - 2) * (1.0 / n + 1.0 / m))
        apart = y.min() > x.max() or y.max() < x.min()
        beyond = abs(shift[key]) > max(own_bound * own, bound * typical)
        moved[key] = Shift(exp(shift[key]), n, m, bool(apart and beyond))
    return moved


def compare_times(before: Night, after: Night, past: Sequence[Night]) -> list[Finding]:
    """Findings about times, without suspects.

    Earlier nights of the same code, versions and processor as `before` are further repetitions of it, but for times
    that were slower in them: a slow-down stays one until it is accepted.  Where `before` is of another processor, the
    oldest of the earlier nights on this one takes its place.
    """
    told = _gone_or_new(before, after)
    if processor(before.info) != processor(after.info):
        change = f"another processor: {processor(before.info)} → {processor(after.info)}"
        here = [night for night in past if processor(night.info) == processor(after.info) and len(night.times)]
        if not here:
            return [*told, _note("times not compared", change)]
        before = min(here, key=lambda night: night.info["started"])
        told.append(_note("times against an earlier night", f"{before.name}; {change}"))
    pool = logs([before])
    slow: list[tuple[Night, dict[Key, Shift]]] = []
    for night in sorted(past, key=lambda n: n.info["started"]):
        if processor(night.info) != processor(before.info) or night.info["run_id"] == before.info["run_id"]:
            continue
        times = logs([night])
        found = shifts(pool, times)
        slow.insert(0, (night, found))
        if _same_code(night, before):
            for key in pool.keys() & times.keys():
                if key not in found or found[key].severity is None:
                    pool[key] += times[key]
    times = logs([after])
    moved = shifts(pool, times)
    few = len(pool.keys() & times.keys()) - len(moved)
    if few:
        told.append(
            _note("too few repetitions", f"{few} times have fewer than {LEAST} on one side: no verdict on them")
        )
    rows = _by_key(after)
    for key, shift in moved.items():
        if shift.severity:
            since = _since(key, shift.severity, slow)
            told.append(_finding(shift.severity, "slower", key, rows[key], shift)._replace(since=since))
        elif shift.sure and 1.0 / shift.factor >= FACTORS["warn"]:
            told.append(_finding("info", "faster", key, rows[key], shift))
    return told


def _same_code(one: Night, other: Night) -> bool:
    digests = {night.info["code"].get("sha256") for night in (one, other)}
    return len(digests) == 1 and one.info["versions"] == other.info["versions"]


def _since(key: Key, severity: str, slow: Sequence[tuple[Night, Mapping[Key, Shift]]]) -> str:
    """The oldest night of the unbroken chain that had it too; those that did not time it are passed over."""
    since = NEW
    for night, found in slow:
        if key in found:
            had = found[key].severity
            if had is None or SEVERITIES.index(had) > SEVERITIES.index(severity):
                break
            since = night.name
    return since


def _gone_or_new(before: Night, after: Night) -> list[Finding]:
    """Times that only one of them has; what did not run is told by its checks."""
    errors = after.checks[after.checks["verdict"] == "error"]
    down = set(zip(errors["unit"], errors["engine"], strict=True))
    ran = {(unit, engine) for unit in after.info["units"] for engine in before.times["engine"]} - down
    told = []
    old, new = logs([before]), logs([after])
    for key, rows in _by_key(before).items():
        if key in old and key not in new and ran.issuperset(zip(rows["unit"], rows["engine"], strict=True)):
            told.append(_about("fail", GONE, key, rows["unit"], "it has no time any more"))
    for key, rows in _by_key(after).items():
        if key in new and key not in old:
            told.append(_about("warn", "new", key, rows["unit"], "it had no time before"))
    return told


def _by_key(night: Night) -> dict[Key, pd.DataFrame]:
    return {tuple(map(str, key)): rows for key, rows in night.times.groupby(TIME_KEY, sort=False)}


def _finding(severity: str, what: str, key: Key, rows: pd.DataFrame, shift: Shift) -> Finding:
    reason = (
        f"{shift.factor:.3g} times the time before over the yardstick ({rows['us_per_sample'].median():.3g} us per"
        f" sample now), {shift.before} against {shift.after} repetitions apart, p = {shift.p:.2g}"
    )
    return _about(severity, what, key, rows["unit"], reason)._replace(ratio=shift.factor)


def _about(severity: str, what: str, key: Key, units: Iterable[str], reason: str) -> Finding:
    row = dict(zip(TIME_KEY, key, strict=True))
    names = list(dict.fromkeys(units))
    setting = " ".join(
        part for part in (row["backend"], row["setting"], row["batch"] and f"batch {row['batch']}") if part
    )
    reproduce = " ".join(["crosscheck nightly", *(f"--unit {name}" for name in names)])
    return Finding(
        severity, what, " ".join(names), row["scene"], row["engine"], row["route"], setting, f"time of {row['task']}",
        reason=reason, reproduce=reproduce,
    )  # fmt: skip


def _note(what: str, reason: str) -> Finding:
    return Finding("info", what, "", "", "", "", "", "", reason=reason)
