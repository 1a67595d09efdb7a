"""The machine's limits: plain arithmetic, and code that does what it is timed for."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from stewart_crosscheck.analytic.compiler import library
from stewart_crosscheck.crosscheck import roofline
from stewart_crosscheck.crosscheck.roofline import Roofline


def test_the_least_time_is_that_of_products_or_of_bytes() -> None:
    limits = Roofline(products=1e10, stored=2e9, loaded=4e9)
    assert limits.seconds({"*": 1000}, read=192, written=48) == pytest.approx(100e-9)
    assert limits.seconds({"*": 100}, read=192, written=48) == pytest.approx((48 + 24) * 1e-9)


def test_the_code_that_is_timed_does_its_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not optimised away: every number is written, read, and multiplied."""
    sources: list[str] = []
    monkeypatch.setattr(roofline, "library", lambda source: (sources.append(source), library(source))[1])
    monkeypatch.setattr(roofline, "MEMORY", 1 << 12)
    monkeypatch.setattr(roofline, "STEPS", 1 << 8)
    limits = roofline.measure()
    assert all(np.isfinite(limits))
    assert min(limits) > 0.0
    code = library(sources[0])
    code.multiply.restype = code.load.restype = ctypes.c_double
    a = np.zeros(1032)
    a = a[(-a.ctypes.data // 8) % 8 :][:1024]
    code.store(ctypes.c_void_p(a.ctypes.data), ctypes.c_long(1024))
    assert (a == 1.0).all()
    assert code.load(ctypes.c_void_p(a.ctypes.data), ctypes.c_long(1024)) == 1024.0
    values = 0.9 * np.arange(roofline.CHAINS)
    for _ in range(10):
        values = 0.9 * values + 0.9
    assert code.multiply(ctypes.c_long(10)) == pytest.approx(8 * values.sum())
