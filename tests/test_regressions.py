"""What became worse: every rule just below and just above its threshold, since when, and the first suspect."""

from __future__ import annotations

from math import inf, isnan, nan
from typing import Any

import pandas as pd
import pytest
from nights import CODE, MACHINE, VERSIONS, check, night, times

from stewart_crosscheck.reports import FINDING_COLUMNS, compare, counts, status
from stewart_crosscheck.reports.checks import RANK

WORSE = {"fail": 1, "warn": 0, "info": 0}


def findings(before: dict[str, Any], after: dict[str, Any]) -> list[tuple[str, str]]:
    """What is told of one row."""
    table = compare(night(0, before), night(1, after))
    return list(zip(table["severity"], table["what"], strict=True))


def one(before: dict[str, Any], after: dict[str, Any]) -> pd.Series:
    table = compare(night(0, before), night(1, after))
    assert len(table) == 1
    return table.iloc[0]


# --- Errors -------------------------------------------------------------------------------------------------------


def test_equal_nights_have_no_findings() -> None:
    rows = [check(), check(quantity="M_s", error=nan, tolerance=nan, margin=nan, verdict="refused", reason="steep")]
    table = compare(night(0, *rows), night(1, *rows))
    assert len(table) == 0
    assert list(table.columns) == FINDING_COLUMNS
    assert status(table) == 0


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (0.49, [("info", "better")]), (0.51, []), (1.0, []), (1.99, []), (2.0, [("warn", "error worse")]),
        (9.99, [("warn", "error worse")]), (10.0, [("fail", "error worse")]), (inf, [("fail", "error worse")]),
    ],
)  # fmt: skip
def test_the_ratio_of_errors(factor: float, told: list[tuple[str, str]]) -> None:
    assert findings(check(), check(error=1e-12 * factor)) == told


def test_the_numbers_of_a_finding() -> None:
    row = one(check(), check(error=2e-11, where="leg 3 at t = 1.5", tolerance=1.5e-10))
    assert row["ratio"] == pytest.approx(20.0)
    assert (row["error_before"], row["error"], row["tolerance"]) == (1e-12, 2e-11, 1.5e-10)
    assert (row["margin_before"], row["margin"]) == pytest.approx((0.01, 0.1333333), rel=1e-5)
    assert row["reason"] == "20 times the error before, leg 3 at t = 1.5, tolerance 1e-10 → 1.5e-10"
    assert row["reproduce"] == "crosscheck run hexapod --engine mujoco"
    assert row["since"] == "this night"


@pytest.mark.parametrize(
    ("floors", "told"),
    [
        ((1e-11, 1e-15), []),
        ((1e-15, 1e-11), [("fail", "error worse")]),  # the one before holds: a wider one would hide what is worse
        ((4.9e-12, 1e-15), [("warn", "error worse")]),
        ((5.1e-12, 1e-15), []),
        ((0.99e-12, nan), [("fail", "error worse")]),
        ((nan, nan), [("fail", "error worse")]),
    ],
)
def test_below_the_floor_at_rounding_nothing_is_told(floors: tuple[float, float], told: list[tuple[str, str]]) -> None:
    assert findings(check(error=1e-13, floor=floors[0]), check(error=1e-11, floor=floors[1])) == told


def test_a_wider_floor_is_told() -> None:
    assert findings(check(floor=1e-15), check(floor=2.1e-15)) == [("warn", "floor wider")]
    assert findings(check(floor=1e-15), check(floor=1.9e-15)) == []
    assert findings(check(floor=1e-15), check(floor=1e-13, tolerance=1e-8)) == [("warn", "tolerance wider")]


def test_an_error_that_was_zero() -> None:
    assert findings(check(error=0.0, floor=0.0), check(error=0.0, floor=0.0)) == []
    assert findings(check(error=0.0, floor=0.0), check(error=1e-300, floor=0.0)) == [("fail", "error worse")]
    assert findings(check(error=0.0, floor=1e-15), check(error=1.9e-15, floor=1e-15)) == []
    assert findings(check(error=1e-12, floor=0.0), check(error=0.0, floor=0.0)) == [("info", "better")]
    assert findings(check(error=inf), check(error=inf)) == []


@pytest.mark.parametrize(("tolerance", "told"), [(2e-10, []), (2.01e-10, [("warn", "tolerance wider")]), (5e-11, [])])
def test_a_wider_tolerance_is_told(tolerance: float, told: list[tuple[str, str]]) -> None:
    assert findings(check(), check(tolerance=tolerance)) == told


def test_a_tolerance_that_is_gone_is_the_widest() -> None:
    row = one(check(), check(tolerance=nan, margin=nan))
    assert (row["what"], row["reason"]) == ("tolerance wider", "tolerance 1e-10 → none")
    assert findings(check(tolerance=nan, margin=nan), check()) == []


def test_a_wider_tolerance_hides_no_error() -> None:
    """Ten times the error under ten times the tolerance has the margin it had."""
    assert findings(check(), check(error=1e-11, tolerance=1e-9)) == [("fail", "error worse")]
    assert findings(check(), check(error=5e-12, tolerance=5e-10)) == [("warn", "error worse")]  # which tells of both


def test_a_number_that_is_lost_is_a_failure() -> None:
    assert findings(check(), check(error=nan, margin=nan)) == [("fail", "no number")]
    assert findings(check(error=nan), check(error=nan)) == []
    assert findings(check(error=nan), check()) == []
    # silently wrong before, and refused now: no number is what was wanted
    silent, refused = check(verdict="silent"), check(verdict="refused", error=nan, margin=nan)
    assert findings(silent, refused) == [("info", "better")]


# --- Verdicts -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("before", RANK)
@pytest.mark.parametrize("after", RANK)
def test_every_change_of_verdict(before: str, after: str) -> None:
    told = findings(check(verdict=before), check(verdict=after))
    if after == "error":
        assert told == [("fail", "did not run")]
    elif after == "fail":
        assert told == [("fail", "fails")]
    elif RANK[after] > RANK[before]:
        assert told == [("warn" if after == "degraded" else "fail", "verdict worse")]
    elif RANK[after] < RANK[before]:
        assert told == [("info", "better")]
    else:
        assert told == []


def test_the_gravest_of_one_row_is_told() -> None:
    row = one(check(verdict="accurate"), check(verdict="degraded", error=2e-11))
    assert (row["severity"], row["what"]) == ("fail", "error worse")
    row = one(check(), check(verdict="unsupported", error=nan, margin=nan, tolerance=nan, reason="no such joint"))
    assert (row["what"], row["reason"]) == ("verdict worse", "pass → unsupported, no such joint")


def test_a_red_row_says_why() -> None:
    row = one(check(), check(verdict="fail", error=3e-10, margin=3.0))
    assert row["reason"] == "3e-10 at leg 1, allowed 1e-10"
    row = one(check(), check(verdict="error", error=nan, margin=nan, reason="killed by signal 9"))
    assert (row["reason"], isnan(row["ratio"])) == ("killed by signal 9", True)


# --- Rows gone and new --------------------------------------------------------------------------------------------


def test_rows_gone_and_new() -> None:
    before, after = night(0, check(), check(quantity="M_s")), night(1, check(), check(quantity="M_n"))
    table = compare(before, after)
    assert list(zip(table["severity"], table["what"], table["quantity"], strict=True)) == [
        ("fail", "gone", "M_s"), ("warn", "new", "M_n"),
    ]  # fmt: skip
    assert table["reason"].tolist() == ["it has no row any more; before: pass", "it had no row before; now: pass"]
    assert table["suspect"].tolist() == ["nothing changed: not reproducible?", ""]
    assert status(table) == 1


def test_every_part_of_the_key_makes_another_row() -> None:
    for name in ("unit", "scene", "engine", "route", "setting", "quantity"):
        table = compare(night(0, check()), night(1, check(**{name: "other"}), units={"run-hexapod": {}, "other": {}}))
        assert set(table["what"]) == {"gone", "new"}, name


def test_whole_units_are_missed_in_a_whole_night() -> None:
    before = night(0, check(), check(unit="audit"))
    told = compare(before, night(1, check(), whole=True))
    assert told[["severity", "what", "unit"]].to_numpy().tolist() == [["fail", "gone", "audit"]]
    assert compare(before, night(1, check(), whole=False)).empty


def test_units_that_were_not_run_are_not_missed() -> None:
    before = night(0, check(), check(unit="audit", quantity="equation 7"))
    assert len(compare(before, night(1, check()))) == 0
    table = compare(before, night(1, check(), units={"run-hexapod": {}, "audit": {}}))
    assert table[["what", "unit"]].to_numpy().tolist() == [["gone", "audit"]]


def test_a_new_row_that_is_red_is_red() -> None:
    table = compare(night(0), night(1, check(verdict="fail"), check(quantity="M_s", verdict="error")))
    assert set(zip(table["severity"], table["what"], strict=True)) == {("fail", "fails"), ("fail", "did not run")}


# --- Status, order, counts ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([check()], 0),
        ([check(error=5e-12)], 0),
        ([check(verdict="error")], 3),
        ([check(error=5e-11)], 1),
        ([check(verdict="fail")], 1),
        ([check(verdict="error"), check(quantity="M_s", verdict="fail")], 1),
        ([], 1),
    ],
)
def test_the_exit_status(rows: list[dict[str, Any]], expected: int) -> None:
    table = compare(night(0, check()), night(1, *rows, units={"run-hexapod": {}}))
    assert status(table) == expected


def test_the_gravest_and_the_largest_come_first() -> None:
    before = night(0, *(check(quantity=name) for name in "abcdefgh"))
    changes = {"a": 3e-12, "b": 2e-11, "c": 5e-12, "d": 4e-11, "e": 1e-13}
    rows = [check(quantity=name, error=error) for name, error in changes.items()]
    elsewhere = check(quantity="h", verdict="fail", error=1e-14)  # at another place, less than before
    after = night(1, *rows, check(quantity="f", verdict="error", error=nan), check(quantity="g"), elsewhere)
    table = compare(before, after)
    assert "".join(table["quantity"]) == "dbhfcae"
    assert counts(table) == {
        ("fail", "error worse"): 2, ("fail", "fails"): 1, ("fail", "did not run"): 1, ("warn", "error worse"): 2,
        ("info", "better"): 1,
    }  # fmt: skip


# --- Since when ---------------------------------------------------------------------------------------------------


def since(*errors: float | None, now: float = 2e-11) -> str:
    """Since when, of nights with these errors (None: the unit was not run), the oldest first."""
    nights = [night(k, check(error=e)) if e is not None else night(k) for k, e in enumerate(errors, 1)]
    table = compare(night(0, check()), night(len(errors) + 1, check(error=now)), nights[::-1])
    return table["since"].iloc[0]


SECOND, THIRD = "night-2 (20261103T030000Z-nightly-0002)", "night-3 (20261104T030000Z-nightly-0003)"


def test_since_when() -> None:
    assert since() == "this night"
    assert since(1e-12, 1e-12) == "this night"
    assert since(1e-12, 2e-11, 2e-11) == SECOND
    assert since(2e-11, 1e-12, 2e-11) == THIRD  # unbroken: it was well in between
    assert since(1e-12, 2e-11, None, None) == SECOND  # nights that did not run it tell nothing
    assert since(1e-12, 1.01e-11) == SECOND  # at least half of now, and over the threshold
    assert since(1e-12, 0.99e-11) == "this night"
    assert since(1e-12, 1.9e-11, now=4e-11) == "this night"
    assert since(1e-12, 9e-11) == SECOND  # worse than now
    assert since(1e-12, 9e-12, now=1.5e-11) == "this night"  # a warning then, and a failure now


def test_since_when_it_is_red_is_lost_or_did_not_run() -> None:
    before, good = night(0, check()), night(1, check())
    red, lost = check(verdict="fail", error=1e-9), check(error=nan)
    broken = check(verdict="error", error=nan)

    def of(now: dict[str, Any], *past: dict[str, Any] | None) -> str:
        nights = [night(k, *([row] if row else []), units={"run-hexapod": {}}) for k, row in enumerate(past, 2)]
        return compare(before, night(9, now), [*nights[::-1], good])["since"].iloc[0]

    assert of(red, red, red) == SECOND
    assert of(red, red, broken, red) == SECOND  # a crash in between tells nothing of the numbers
    assert of(red, check(error=1e-8)) == "this night"  # it was not red then
    assert of(check(error=5e-11), red) == SECOND
    assert of(broken, broken, broken) == SECOND
    assert of(broken, lost, broken) == THIRD
    assert of(broken, red, broken) == THIRD  # red since before, but it ran
    assert of(lost, lost) == SECOND
    assert of(check(tolerance=5e-10), red) == "this night"


def test_since_when_a_row_is_gone() -> None:
    kept, gone = check(quantity="M_s"), check()
    past = [night(2, kept), night(1, kept, gone)]
    table = compare(night(0, kept, gone), night(3, kept), past)
    assert table[["what", "since"]].to_numpy().tolist() == [["gone", past[0].name]]


# --- The first suspect --------------------------------------------------------------------------------------------


def suspect(row: dict[str, Any], **changes: Any) -> str:
    rest = [check(engine=name, quantity="other") for name in ("mujoco", "pinocchio", "analytic")]
    rest_after = [
        r | {"engine_version": changes.get("engine_versions", {}).get(r["engine"], r["engine_version"])} for r in rest
    ]
    facts = {name: value for name, value in changes.items() if name != "engine_versions"}
    table = compare(night(0, *rest, check(engine=row["engine"])), night(1, *rest_after, row, **facts))
    return table.loc[table["severity"] != "info", "suspect"].iloc[0]


def test_the_row_s_own_engine_is_the_first_suspect() -> None:
    newer = {"versions": VERSIONS | {"mujoco": "4.1.0", "numpy": "2.5.0"}, "code": {"commit": "f" * 16, "sha256": "x"}}
    row = check(error=1e-10, engine_version="4.1.0")
    assert suspect(row, **newer, engine_versions={"mujoco": "4.1.0"}) == "mujoco 4.0.0 → 4.1.0"


def test_another_engine_is_no_suspect_but_a_shared_package_is() -> None:
    mujoco = {"versions": VERSIONS | {"mujoco": "4.2.0"}, "engine_versions": {"mujoco": "4.2.0"}}
    row = check(engine="pinocchio", error=1e-10)
    assert suspect(row, **mujoco) == "nothing changed: not reproducible?"
    mujoco["versions"] |= {"numpy": "2.5.0", "python": "3.12.0"}
    assert suspect(row, **mujoco) == "python 3.11.9 → 3.12.0; numpy 2.4.0 → 2.5.0"


def test_then_the_code_then_the_machine() -> None:
    row = check(error=1e-10)
    assert suspect(row, code={"commit": "f" * 16, "sha256": "other"}) == "code 012345678 → fffffffff"
    assert suspect(row, code=CODE | {"sha256": "other"}) == "code c0dec0dec → other"
    changed = {"commit": f"{CODE['commit']}+", "sha256": "other"}
    assert suspect(row, code=changed) == "code 012345678 → 012345678+"  # and not committed
    assert suspect(row, code=CODE | {"commit": "f" * 16}) == "nothing changed: not reproducible?"  # words only
    other = suspect(row, machine=MACHINE | {"model": "B"})
    assert other == "x86_64, A processor, 2 cores → x86_64, B, 2 cores"
    assert suspect(row) == "nothing changed: not reproducible?"


def test_a_crashed_unit_without_a_version_is_no_change_of_its_engine() -> None:
    crashed = check(verdict="error", error=nan, engine_version="")
    assert suspect(crashed) == "nothing changed: not reproducible?"
    gone = {"engine_versions": {"mujoco": ""}}
    assert suspect(crashed, **gone) == "nothing changed: not reproducible?"
    missing = suspect(crashed, **gone, versions=VERSIONS | {"mujoco": None})
    assert missing == "mujoco 4.0.0 → not installed"


def test_every_change_of_versions_and_code_is_a_row() -> None:
    new = {name: version for name, version in VERSIONS.items() if name != "pin"} | {"mujoco": "4.1.0", "dartpy": "6.20"}
    table = compare(night(0, check()), night(1, check(), versions=new, code={"commit": "f" * 16, "sha256": "x"}))
    assert table[["severity", "what", "quantity", "reason"]].to_numpy().tolist() == [
        ["info", "code changed", "code", "012345678 → fffffffff"],
        ["info", "version changed", "dartpy", "not installed → 6.20"],
        ["info", "version changed", "mujoco", "4.0.0 → 4.1.0"],
        ["info", "version changed", "pin", "4.1.0 → not installed"],
    ]
    assert status(table) == 0


# --- Times --------------------------------------------------------------------------------------------------------


def timed(before: list[dict[str, Any]], after: list[dict[str, Any]], **facts: Any) -> pd.DataFrame:
    return compare(night(0, times=before), night(1, times=after, **facts))


def test_times_without_a_partner() -> None:
    table = timed(times(1.0, 1.1, 0.9), times(1.0, 1.1, 0.9, batch=64))
    assert table[["severity", "what", "setting", "quantity"]].to_numpy().tolist() == [
        ["fail", "gone", "batch 1", "time of driving_forces"], ["warn", "new", "batch 64", "time of driving_forces"],
    ]  # fmt: skip
    assert table["reproduce"].iloc[0] == "crosscheck nightly --unit bench-1 --unit bench-2 --unit bench-3"
    assert timed(times(1.0, 1.1, 0.9), times(nan, nan, nan))["what"].tolist() == ["gone"]


def test_times_of_units_that_were_not_run_or_crashed_are_not_missed() -> None:
    before = night(0, check(unit="bench-1"), times=times(1.0))
    assert len(compare(before, night(1, units={}))) == 0
    crashed = night(1, check(unit="bench-1", verdict="error", error=nan))
    assert compare(before, crashed)["what"].tolist() == ["did not run"]
    other = night(1, check(unit="bench-1"), check(unit="bench-1", engine="dart", verdict="error"))
    assert compare(before, other)["what"].tolist() == ["did not run", "gone"]


def test_too_few_repetitions_are_told_once() -> None:
    one, two = times(1.0, 1.0), times(5.0, 5.0, 5.0)
    table = timed([*one, *times(1.0, task="b")], [*two, *times(9.0, 9.0, 9.0, task="b")])
    assert table[["severity", "what", "reason"]].to_numpy().tolist() == [
        ["info", "too few repetitions", "2 times have fewer than 3 on one side: no verdict on them"]
    ]


@pytest.mark.parametrize("change", [{"processor": "aarch64"}, {"model": "B"}, {"usable_cores": 4}])
def test_times_of_another_processor_are_not_compared(change: dict[str, Any]) -> None:
    table = timed(times(1.0, 1.1, 0.9), times(9.0, 9.1, 8.9), machine=MACHINE | change)
    assert table[["severity", "what"]].to_numpy().tolist() == [["info", "times not compared"]]
    assert status(table) == 0
