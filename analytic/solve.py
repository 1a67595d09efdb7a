"""The solve of (7), (8), of (32) or (35): arrays of samples with a condition test, or single numbers of any kind."""

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


class Infeasible(ArithmeticError):
    """A prescribed motion that no driving forces give: names the sample, the residual and its limit."""

    def __init__(self, sample: int, residual: float, limit: float) -> None:
        super().__init__(
            f"sample {sample}: the motion is infeasible: an equation of the platform holds no driving force, and what"
            f" it asks of the motion is missed by {residual:.6g} (N or N m), expected at most {limit:.2g}"
        )
        self.sample, self.residual = sample, residual


FEASIBLE = 1e-12
"""Largest residual of an equation without driving forces, over the largest right side: rounding of some ten terms."""


def row_scaled(A: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row lengths (nt, n), 2-norm condition (nt,) of the matrices with rows of length 1, and the weakest leg (nt,).

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
    """Raise SingularPose if a scaled condition is above ``LIMIT``, or not a number."""
    worst = int(np.argmax(condition))
    if not condition[worst] <= LIMIT:
        limit = f"above {LIMIT:g}: the platform is in a parallel singularity"
        name = "row-scaled condition of the platform's equations"
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


def without_vanishing_rows(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Condition (nt,) of planar equations (nt, n, n) less their rows of zeros, and whether there are such rows.

    The two rows of forces have one unit and are scaled by the longer one: a short one, of legs that are nearly square
    to its axis, is a weakness that scaling must not hide.  A row vanishes exactly where the legs are exactly square to
    it, as two collinear ones are.
    """
    length = np.linalg.norm(A, axis=2)
    rank = (A != 0.0).any(axis=2).sum(axis=1)  # by the entries: a norm underflows
    length[:, :2] = length[:, :2].max(axis=1, keepdims=True)
    length[length == 0.0] = 1.0
    sigma = np.linalg.svd(A / length[..., None], compute_uv=False)
    smallest = np.take_along_axis(sigma, np.maximum(rank - 1, 0)[:, None], axis=1)[:, 0]
    with np.errstate(divide="ignore"):
        condition = sigma[:, 0] / np.abs(smallest)
    condition[rank < A.shape[1] - 1] = np.inf  # more than one combination would be free
    return condition, rank < A.shape[1]


def solve_determined(
    rows: Sequence[Sequence[np.ndarray]], right: Sequence[np.ndarray], first_sample: int = 0
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """As `solve_samples` for n rows of which some may vanish: the shortest vector that fulfils the others.

    Returns
    -------
    unknowns : n arrays (nt,)
    condition : ndarray, shape (nt,), of the rows that do not vanish.
    undetermined : ndarray of bool, shape (nt,)

    Raises
    ------
    SingularPose
        Condition above ``LIMIT``.
    Infeasible
        The right side of a row that vanishes is not zero.
    """
    A = np.moveaxis(np.array(rows), -1, 0)
    b = np.array(right).T
    length, _, leg = row_scaled(A)
    condition, undetermined = without_vanishing_rows(A)
    require_regular(condition, leg, first_sample)
    residual = np.where((A == 0.0).all(axis=2), np.abs(b), 0.0).max(axis=1)
    limit = FEASIBLE * float(np.abs(b).max())
    worst = int(np.argmax(residual))
    if residual[worst] > limit:
        raise Infeasible(first_sample + worst, float(residual[worst]), limit)
    scaled, target = A / length[..., None], (b / length)[..., None]
    x = np.empty_like(target)
    x[~undetermined] = np.linalg.solve(scaled[~undetermined], target[~undetermined])
    x[undetermined] = np.linalg.pinv(scaled[undetermined]) @ target[undetermined]
    return list(x[..., 0].T), condition, undetermined


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
