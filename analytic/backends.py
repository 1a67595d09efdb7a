"""Back ends: the one text of the formulas on arrays, on plain floats, or compiled.  Each fills the same rows."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Protocol

import numpy as np

from .compiled import Compiled
from .evaluate import REGULAR, Mechanism, Problem
from .registers import NumPy, bound
from .samples import parts
from .solve import ordered_numbers
from .traced import traced


class BackEnd(Protocol):
    """Answers a problem of a machine."""

    size: int
    """Most samples at a time."""

    def fill(self, inputs: Sequence[np.ndarray], numbers: np.ndarray) -> bool:
        """Write the results of n samples into their rows of ``numbers`` (rows, n); whether all are beyond doubt.

        ``inputs``: arrays (n, ...) of the problem's widths.  What is not finite makes doubt, and so does what is not
        regular.
        """
        ...


class Floats:
    """Plain floats, sample by sample: the fastest for one, and without any library."""

    size = 1

    def __init__(self, P: Mechanism, problem: Problem) -> None:
        self.P, self.problem, self.rows = P, problem, problem.rows(P)

    def fill(self, inputs: Sequence[np.ndarray], numbers: np.ndarray) -> bool:
        """One sample."""
        x = [number for a in inputs for number in a.ravel().tolist()]
        try:
            out, regularity = self.problem.evaluate(self.P, x, math.sqrt, ordered_numbers)
        except (ZeroDivisionError, OverflowError):
            return False
        numbers[self.rows, 0] = out
        return regularity >= REGULAR and all(map(math.isfinite, (*x, *out)))


BACKENDS: dict[str, Callable[[Mechanism, Problem], BackEnd]] = {"numpy": NumPy, "float": Floats, "compiled": Compiled}


@functools.lru_cache(maxsize=64)
def back_end(name: str, P: Mechanism, problem: Problem) -> BackEnd:
    """A back end by its name, for a machine of floats."""
    return BACKENDS[name](P, problem)


def forget() -> None:
    """Drop all that was made of the formulas, for whoever changes their text while it runs."""
    for made in (back_end, bound, traced):
        made.cache_clear()


def answer(
    P: Mechanism,
    problem: Problem,
    inputs: Sequence[np.ndarray],
    backend: str | None,
    out: np.ndarray,
) -> Iterable[slice]:
    """Fill the rows of ``out`` (rows, nt) block by block; hands out the blocks that are in doubt.

    ``P``: as `in_floats` gives it.  Without a name of a back end: plain floats for a single sample, NumPy for more.
    """
    if backend is not None and backend not in [*BACKENDS]:
        raise ValueError(f"backend: got {backend!r}, expected one of {', '.join(BACKENDS)}")
    nt = out.shape[1]
    made = back_end(backend or ("float" if nt == 1 else "numpy"), P, problem)
    for block in parts(nt, made.size):
        if not made.fill([a[block] for a in inputs], out[:, block]):
            yield block
