"""The 6 x 6 solve of (7), (8): for arrays of samples with a condition test, and for single numbers of any kind."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .stewart import Scalar

LIMIT = 1e12
"""Largest row-scaled condition, and largest 1/s of a leg with spin inertia, that leaves digits in the answer.

Both multiply the rounding of float64 (1e-16): at 1e12 four digits are left.
"""


class SingularPose(ArithmeticError):
    """A pose whose driving forces cannot be computed: names sample and leg (from 1) and the number."""

    def __init__(self, sample: int, leg: int, name: str, value: float, limit: str) -> None:
        super().__init__(f"sample {sample}, leg {leg}: {name} = {value:.3g}, {limit}")
        self.sample, self.leg, self.name, self.value, self.limit = sample, leg, name, value, limit


def row_scaled(A: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row lengths (nt, 6), 2-norm condition (nt,) of the matrices with rows of length 1, and the weakest leg (nt,).

    Force and moment rows have different units, so that only the scaled condition means anything.  The weakest leg
    (from 1) has the largest share in the direction that no force holds.
    """
    length = np.linalg.norm(A, axis=2)
    length[length == 0.0] = 1.0
    _, sigma, Vh = np.linalg.svd(A / length[..., None])
    with np.errstate(divide="ignore"):
        condition = sigma[:, 0] / np.abs(sigma[:, -1])  # LAPACK returns -0.0 too
    return length, condition, np.argmax(np.abs(Vh[:, -1]), axis=1) + 1


def require_regular(condition: np.ndarray, leg: np.ndarray, first_sample: int = 0) -> None:
    """Raise SingularPose if a row-scaled condition is above ``LIMIT``, or not a number."""
    worst = int(np.argmax(condition))
    if not condition[worst] <= LIMIT:
        limit = f"above {LIMIT:g}: the platform is in a parallel singularity"
        name = "row-scaled condition of (7), (8)"
        raise SingularPose(first_sample + worst, int(leg[worst]), name, float(condition[worst]), limit)


def solve_samples(
    rows: Sequence[Sequence[np.ndarray]], right: Sequence[np.ndarray], first_sample: int = 0
) -> tuple[list[np.ndarray], np.ndarray]:
    """Solve one row-scaled 6 x 6 system per sample.

    Parameters
    ----------
    rows : six rows of six arrays, each (nt,)
    right : six arrays, each (nt,)
    first_sample : number of the first sample, for the error message.

    Returns
    -------
    unknowns : six arrays (nt,)
    condition : ndarray, shape (nt,), of the row-scaled matrix.

    Raises
    ------
    SingularPose
        Condition above ``LIMIT``.
    """
    A = np.moveaxis(np.array(rows), -1, 0)
    b = np.array(right).T
    length, condition, leg = row_scaled(A)
    require_regular(condition, leg, first_sample)
    return list(np.linalg.solve(A / length[..., None], (b / length)[..., None])[..., 0].T), condition


def solve_numbers(rows: Sequence[Sequence[Scalar]], right: Sequence[Scalar]) -> list[Scalar]:
    """Gaussian elimination with partial pivoting for any numbers with ``+ - * /`` and ``float()``: floats, balls.

    Raises
    ------
    ZeroDivisionError
        A pivot is zero (floats); balls return non-finite balls instead.
    """
    M: list[list[Any]] = [[*row, b] for row, b in zip(rows, right, strict=True)]
    n = len(M)
    for j in range(n):
        pivot = max(range(j, n), key=lambda i: abs(float(M[i][j])))
        M[j], M[pivot] = M[pivot], M[j]
        for i in range(j + 1, n):
            factor = M[i][j] / M[j][j]
            M[i] = [a - factor * b for a, b in zip(M[i], M[j], strict=True)]
    x: list[Any] = [None] * n
    for j in reversed(range(n)):
        x[j] = (M[j][n] - sum(M[j][i] * x[i] for i in range(j + 1, n))) / M[j][j]
    return x
