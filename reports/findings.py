"""What is worth telling of two rows that are about the same thing, one of each of two nights."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, isnan, nan
from typing import Any, NamedTuple

from .checks import CHECK_KEY, RANK, RED

SEVERITIES = ("fail", "warn", "info")

WARN, FAIL = 2.0, 10.0
"""Times the error before: errors of one code on one machine repeat to the last digit, and another processor or
compiler reorders sums, which is what the floor at rounding allows for; a factor of ten is a digit lost."""

WIDER = 2.0
"""Times the tolerance before, above which it is told: a check that allows more says less."""

Row = Mapping[str, Any]


class Finding(NamedTuple):
    """One difference between two nights; the fields are the columns of regressions.csv.

    ``ratio``: of the errors, each at least the floor, or of the times. ``margin``: error over tolerance.
    """

    severity: str
    what: str
    unit: str
    scene: str
    engine: str
    route: str
    setting: str
    quantity: str
    error_before: float = nan
    error: float = nan
    ratio: float = nan
    tolerance: float = nan
    margin_before: float = nan
    margin: float = nan
    since: str = ""
    suspect: str = ""
    reason: str = ""
    reproduce: str = ""


FINDING_COLUMNS = list(Finding._fields)
FAILS, NOT_RUN = "fails", "did not run"
GONE = "gone"
NEW = "this night"
"""``since`` of what no earlier night had."""


def error_ratio(before: Row, after: Row) -> float:
    """Error after over error before, both at least what rounding alone might be before; NaN where one has no error.

    What it may be now does not count: a wider tolerance would hide what it is to be judged by.
    """
    floor = 0.0 if isnan(before["floor"]) else before["floor"]
    if isnan(before["error"]) or isnan(after["error"]):
        return nan
    old, new = max(before["error"], floor), max(after["error"], floor)
    return 1.0 if new == old else new / old if old else inf


def judge(before: Row | None, after: Row | None) -> list[Finding]:
    """What to tell of a row, None where a night has none: the gravest about its result, and that it allows more."""
    if after is None:
        reason = f"it has no row any more; before: {before['verdict'] if before else ''}"
        return [_finding("fail", GONE, before, None, reason)]
    if after["verdict"] in RED:
        what = NOT_RUN if after["verdict"] == "error" else FAILS
        return [_finding("fail", what, before, after, after["reason"] or missed(after))]
    if before is None:
        return [_finding("warn", "new", None, after, f"it had no row before; now: {after['verdict']}")]
    told = sorted(_changes(before, after), key=lambda f: SEVERITIES.index(f.severity))[:1]
    if not any(finding.severity == "fail" or finding.what == "error worse" for finding in told):
        old, new = (inf if isnan(x["tolerance"]) else x["tolerance"] for x in (before, after))
        if new > WIDER * old:
            told.append(_finding("warn", "tolerance wider", before, after, _tolerances(before, after)))
        elif after["floor"] > WIDER * before["floor"]:
            change = f"what counts as rounding {before['floor']:.3g} → {after['floor']:.3g}"
            told.append(_finding("warn", "floor wider", before, after, change))
    return told


def _changes(before: Row, after: Row) -> list[Finding]:
    """The verdict and the error, each where it changed."""
    told = []
    step = RANK[after["verdict"]] - RANK[before["verdict"]]
    verdicts = f"{before['verdict']} → {after['verdict']}"
    if step > 0:
        severity = "warn" if after["verdict"] == "degraded" else "fail"
        told.append(_finding(severity, "verdict worse", before, after, _sentence(verdicts, after["reason"])))
    ratio = error_ratio(before, after)
    if isnan(after["error"]) and not isnan(before["error"]) and step >= 0:
        told.append(_finding("fail", "no number", before, after, _sentence("an error no more", after["reason"])))
    elif ratio >= WARN:
        than = "the error before" if before["error"] >= before["floor"] else "the rounding before"
        text = _sentence(f"{ratio:.3g} times {than}", after["where"], after["reason"])
        if before["tolerance"] != after["tolerance"] and not isnan(before["tolerance"]):
            text = _sentence(text, _tolerances(before, after))
        told.append(_finding("fail" if ratio >= FAIL else "warn", "error worse", before, after, text))
    if step < 0:
        told.append(_finding("info", "better", before, after, verdicts))
    elif ratio <= 1.0 / WARN:
        told.append(_finding("info", "better", before, after, f"{ratio:.3g} times the error before"))
    return told


def _sentence(*parts: str) -> str:
    return ", ".join(part for part in parts if part)


def _tolerances(before: Row, after: Row) -> str:
    old, new = ("none" if isnan(x["tolerance"]) else f"{x['tolerance']:.3g}" for x in (before, after))
    return f"tolerance {old} → {new}"


def missed(row: Row) -> str:
    """By what a row fails."""
    where = f" at {row['where']}" if row["where"] else ""
    return f"{row['error']:.3g}{where}, allowed {row['tolerance']:.3g}"


def _finding(severity: str, what: str, before: Row | None, after: Row | None, reason: str) -> Finding:
    row: Row = after or before or {}
    numbers: dict[str, Any] = {}
    if before:
        numbers |= {"error_before": before["error"], "margin_before": before["margin"]}
    if after:
        numbers |= {name: after[name] for name in ("error", "tolerance", "margin")}
    if before and after:
        numbers["ratio"] = error_ratio(before, after)
    about = {name: row[name] for name in CHECK_KEY}
    return Finding(severity, what, **about, **numbers, reason=reason, reproduce=row["reproduce"])
