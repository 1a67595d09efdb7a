"""A night as JUnit XML, for build systems: every check is a test case, and so is every regression."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from .checks import CHECK_KEY
from .findings import FAILS, NOT_RUN, missed
from .history import Night, name_of, printable

if TYPE_CHECKING:
    import pandas as pd
    from junitparser import TestCase


def junit(night: Night, findings: pd.DataFrame) -> str:
    """A suite for each unit, with a case for each row of checks, and the suite `regressions`: what else is worse."""
    from junitparser import JUnitXml, TestSuite

    is_red = findings["what"].isin([FAILS, NOT_RUN])
    told = {tuple(row[k] for k in CHECK_KEY): row for row in findings[is_red].to_dict("records")}
    xml = JUnitXml(printable(night.info["run_id"]))
    for unit, rows in night.checks.groupby("unit", sort=False):
        suite = TestSuite(printable(str(unit)))
        for row in rows.to_dict("records"):
            finding = told.get(tuple(row[k] for k in CHECK_KEY), {})
            row |= {name: finding[name] for name in ("since", "suspect") if name in finding}
            suite.add_testcase(_case(row, row["verdict"]))
        xml.add_testsuite(suite)
    suite = TestSuite("regressions")
    failed = findings[(findings["severity"] == "fail") & ~is_red]
    suite.add_testcases([_case(row, row["what"]) for row in failed.to_dict("records")])
    xml.add_testsuite(suite)
    return xml.tostring().decode()


def _case(row: Mapping[Any, Any], outcome: str) -> TestCase:
    """Of a row of checks by its verdict, of a finding by what it is."""
    from junitparser import Error, Failure, Skipped, TestCase

    case = TestCase(
        printable(name_of(row, ("scene", "setting", "quantity"))),
        printable(".".join(str(row[name]) for name in ("unit", "engine", "route"))),
    )
    kinds = {"error": Error, "unsupported": Skipped}
    kind = kinds.get(outcome, Failure if "what" in row or outcome == "fail" else None)
    if kind:
        reason = row["reason"] or missed(row)
        result = kind(printable(f"{outcome}: {reason}"), outcome)
        facts = [*(f"{name}: {row[name]}" for name in CHECK_KEY), f"error: {row['error']:.3g}"]
        facts += [f"{name}: {row[name]}" for name in ("since", "suspect", "where", "reproduce") if row.get(name)]
        result.text = "\n".join(printable(fact) for fact in facts)
        case.result = [result]
    return case
