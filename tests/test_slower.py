"""Times: nothing is said of noise, and what became twice as slow is found. All noise is drawn, no clock is read."""

from __future__ import annotations

from math import log
from typing import Any

import numpy as np
import pandas as pd
import pytest
from nights import CODE, MACHINE, VERSIONS, check, night, times

from stewart_crosscheck.reports import Night, compare
from stewart_crosscheck.reports.slower import FACTORS, FALSE_ALARM, Shift, shifts

ROWS = 200


def shifted(*factors: float, x: tuple[float, ...] = (0.99, 1.0, 1.01), y: tuple[float, ...] = (0.99, 1.0, 1.01)) -> Any:
    """How far the first of some times moved that moved by these factors; the others did not."""
    moved = dict(enumerate(factors)) | {k: 1.0 for k in range(len(factors), 9)}
    before = {(str(k),): [log(v) for v in x] for k in moved}
    after = {(str(k),): [log(factor * v) for v in y] for k, factor in moved.items()}
    return shifts(before, after)["0",]


@pytest.mark.parametrize(
    ("factor", "severity"),
    [(0.4, None), (1.0, None), (1.249, None), (1.251, "warn"), (1.99, "warn"), (2.01, "fail"), (50.0, "fail")],
)
def test_the_factors_at_their_thresholds(factor: float, severity: str | None) -> None:
    found = shifted(factor)
    assert found.severity == severity
    assert found.factor == pytest.approx(factor)
    assert (found.before, found.after, found.p) == (3, 3, pytest.approx(1 / 20))


def test_samples_that_overlap_say_nothing() -> None:
    assert not shifted(3.0, x=(1.0, 1.0, 1.0, 1.0, 1.0, 3.05)).sure
    assert shifted(3.0, x=(1.0, 1.0, 1.0, 1.0, 1.0, 2.95)).sure
    assert shifted(3.0, x=(1.0, 1.0, 1.0, 1.05), y=(1.0, 1.0, 1.0)).severity == "fail"


def test_one_sample_that_is_off_says_nothing() -> None:
    assert shifted(1.0, y=(1.0, 1.0, 30.0)).severity is None
    assert shifted(2.5, y=(1.0, 1.0, 0.3)).severity is None


def test_fewer_than_three_repetitions_say_nothing() -> None:
    two, three = [0.0, 0.0], [1.0, 1.0, 1.0]
    assert shifts({("a",): two}, {("a",): three}) == shifts({("a",): three}, {("a",): two}) == {}
    assert shifts({}, {("a",): three}) == {}


def test_a_single_row_is_judged_by_its_own_noise() -> None:
    assert shifts({("a",): [0.0, 0.01, -0.01]}, {("a",): [0.8, 0.81, 0.79]})["a",].severity == "fail"
    assert shifts({("a",): [0.0, 0.4, -0.4]}, {("a",): [0.8, 0.5, 1.1]})["a",].severity is None


def drawn(
    rng: np.random.Generator, rows: int, repetitions: int, noise: float, between: float = 0.0, tails: bool = False
) -> dict[tuple[str, ...], list[float]]:
    """Logarithms of a night: noise within it, and what all repetitions of a row share that night."""
    size = (rows, repetitions)
    inner = rng.standard_t(3, size) if tails else rng.standard_normal(size)
    x = noise * inner + between * rng.standard_normal((rows, 1))
    return {(str(k),): row.tolist() for k, row in enumerate(x)}


def slowed(times: dict[tuple[str, ...], list[float]], rows: int, factor: float) -> dict[tuple[str, ...], list[float]]:
    return {key: [v + log(factor) * (int(key[0]) < rows) for v in row] for key, row in times.items()}


def alarms(moved: dict[tuple[str, ...], Shift], rows: range) -> int:
    return sum(moved[(str(k),)].severity is not None for k in rows)


@pytest.mark.parametrize(
    ("noise", "between", "tails"),
    [(0.02, 0.0, False), (0.1, 0.0, False), (0.3, 0.0, False), (0.05, 0.0, True), (0.02, 0.1, False)],
)
def test_noise_raises_an_alarm_in_few_nights(noise: float, between: float, tails: bool) -> None:
    """FALSE_ALARM of nights for normal noise of any size; the count of 40 nights leaves room for its tails."""
    rng = np.random.default_rng(6)
    nights = [
        alarms(
            shifts(drawn(rng, ROWS, 3, noise, between, tails), drawn(rng, ROWS, 3, noise, between, tails)), range(ROWS)
        )
        for _ in range(40)
    ]
    assert FALSE_ALARM <= 0.01
    assert sum(n > 0 for n in nights) <= 3
    assert sum(nights) <= 4


def test_the_noise_of_all_rows_is_what_bounds_the_alarms() -> None:
    """Judged one by one, as if there were no others, rows of the same kind of nights raise alarms by the dozen."""
    rng = np.random.default_rng(6)
    before, after = drawn(rng, ROWS, 3, 0.02, 0.1), drawn(rng, ROWS, 3, 0.02, 0.1)
    alone = [shifts({key: before[key]}, {key: after[key]})[key] for key in before]
    assert sum(moved.severity is not None for moved in alone) >= 12
    assert alarms(shifts(before, after), range(ROWS)) == 0


@pytest.mark.parametrize("slow", [1, 20, 100, 140, ROWS])
def test_what_became_twice_as_slow_is_found(slow: int) -> None:
    """One row, an engine, exactly half of all rows, most, all of them."""
    rng = np.random.default_rng(7)
    found = false = 0
    for _ in range(10):
        after = slowed(drawn(rng, ROWS, 3, 0.05), slow, 2.1)
        moved = shifts(drawn(rng, ROWS, 3, 0.05), after)
        found += alarms(moved, range(slow))
        false += alarms(moved, range(slow, ROWS))
    assert found >= 0.95 * 10 * slow
    assert false <= 1


# --- Nights -------------------------------------------------------------------------------------------------------


def timed(day: int, *factors: float, noise: float = 0.01, **facts: Any) -> Night:
    """A night whose first times moved by these factors."""
    rng = np.random.default_rng(day)
    rows = []
    for k in range(12):
        factor = factors[k] if k < len(factors) else 1.0
        rows += times(*(factor * np.exp(noise * rng.standard_normal(3))), task=f"task {k:02d}")
    return night(day, times=rows, **facts)


def told(table: pd.DataFrame) -> list[tuple[str, str, str]]:
    rows = table[~table["what"].isin(["code changed", "version changed"])]
    return [tuple(row) for row in rows[["severity", "what", "quantity"]].to_numpy().tolist()]


def test_a_slower_time_is_told_with_its_numbers() -> None:
    table = compare(timed(0), timed(1, 2.5, 1.5, 0.5, versions=VERSIONS | {"numpy": "2.5.0"}))
    assert told(table) == [
        ("fail", "slower", "time of task 00"),
        ("warn", "slower", "time of task 01"),
        ("info", "faster", "time of task 02"),
    ]
    row = table.iloc[0]
    assert row["ratio"] == pytest.approx(2.5, rel=0.05)
    assert row["suspect"] == "numpy 2.4.0 → 2.5.0"
    assert row["unit"] == "bench-1 bench-2 bench-3"
    assert "3 against 3 repetitions apart, p = 0.05" in row["reason"]


def test_since_when_it_is_slower() -> None:
    new: dict[str, Any] = {"code": CODE | {"sha256": "new"}}
    nights = [timed(1), timed(2, 2.5, **new), timed(3, **new), timed(4, 2.5, **new), timed(5, 2.5, **new), night(6)]
    table = compare(timed(0), timed(7, 2.5, **new), nights[::-1])
    assert table[table["what"] == "slower"]["since"].tolist() == [nights[3].name]
    assert compare(timed(0), timed(7, 2.5), [timed(1)])["since"].tolist() == ["this night"]
    # it failed at 2.5 for the first time: it was slower before, but not as bad
    table = compare(timed(0), timed(7, 2.5, **new), [timed(2, 1.5, **new)])
    assert table["since"].iloc[0] == "this night"


def test_earlier_nights_of_the_same_code_are_further_repetitions() -> None:
    past = [timed(day, noise=0.1) for day in (3, 2, 1)]
    table = compare(timed(0), timed(4, 3.0), past)
    assert "12 against 3 repetitions apart" in table["reason"].iloc[0]
    changes: list[dict[str, Any]] = [
        {"code": CODE | {"sha256": "other"}},
        {"versions": VERSIONS | {"numpy": "9"}},
        {"machine": MACHINE | {"model": "B"}},
    ]
    for facts in changes:
        other = [timed(day, **facts) for day in (3, 2, 1)]
        assert "3 against 3" in compare(timed(0), timed(4, 3.0), other)["reason"].iloc[0]
    assert "3 against 3" in compare(timed(0), timed(4, 3.0), [timed(0)])["reason"].iloc[0]  # the accepted one itself


def test_a_slow_down_stays_one_though_nothing_changed() -> None:
    """Nights that have it do not become the measure of the next one."""
    past: list[Night] = []
    for day in range(1, 6):
        after = timed(day, 2.5)
        table = compare(timed(0), after, past)
        assert told(table) == [("fail", "slower", "time of task 00")]
        assert table["suspect"].iloc[0] == "nothing changed: not reproducible?"
        assert table["since"].iloc[0] == (past[-1].name if past else "this night")
        past.insert(0, after)


def test_many_nights_of_noise_and_then_a_slow_down() -> None:
    """Twenty nights through the whole of `compare`: the alarms are counted, and the slow-down is found each night."""
    past: list[Night] = []
    false = found = 0
    for day in range(1, 21):
        after = timed(day, 2.2 if day > 15 else 1.0, noise=0.08, code=CODE | {"sha256": str(day)})
        slower = [row for row in told(compare(timed(0, noise=0.08), after, past)) if row[1] == "slower"]
        found += sum(row[2] == "time of task 00" for row in slower if day > 15)
        false += sum(row[2] != "time of task 00" or day <= 15 for row in slower)
        past.insert(0, after)
    assert found >= 4
    assert false <= 2


def test_the_thresholds_are_the_published_ones() -> None:
    assert FACTORS == {"fail": 2.0, "warn": 1.25}


def test_a_baseline_of_another_processor_gives_way_to_the_oldest_night_on_this_one() -> None:
    elsewhere = night(0, check(), times=times(1.0, 1.01, 0.99))
    here = {"machine": MACHINE | {"model": "B"}}
    first, slow = night(1, check(), times=times(3.0, 3.01, 2.99), **here), times(7.0, 7.01, 6.99)
    told = compare(elsewhere, night(3, check(), times=slow, **here), [first])
    assert {"slower", "times against an earlier night"} <= set(told["what"])
    assert told.loc[told["what"] == "slower", "ratio"].iloc[0] == pytest.approx(7.0 / 3.0, rel=1e-2)
    told = compare(elsewhere, night(3, check(), times=slow, **here))
    assert "times not compared" in set(told["what"])
    assert "slower" not in set(told["what"])
