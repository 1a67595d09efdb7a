"""Defects of engines that the project works around: each one as the smallest model that shows it.

A test asserts what would be right, and is expected to fail.  With a version of the engine that has put it right it
passes, which is reported as a failure ``[XPASS(strict)]`` with the text that says what can go.  Nothing of this project
is imported: what is left of a test without its marks is a report to the engine's authors.
"""

from __future__ import annotations

import pytest


def defect(what: str, workaround: str) -> pytest.MarkDecorator:
    """Mark of a test that shows a defect; `workaround`: where the project gets by, and what to look at."""
    reason = f"{what}. If this test passes, the engine has been put right: look at {workaround}"
    return pytest.mark.xfail(raises=AssertionError, strict=True, reason=reason)


def control(right: bool) -> None:
    """What must be right for the test to mean anything: unlike the defect it is not expected to fail."""
    if not right:
        raise RuntimeError("the control of this defect fails: the test shows something else")
