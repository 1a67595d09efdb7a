"""How hard a pose is, from its geometry alone: tolerances hang on it, so that no formula under test has a say."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..analytic.solve import SingularPose, conditioned, longest_lever, require_regular, without_vanishing_row
from ..models.scene import Scene


class Conditioning(NamedTuple):
    """Per sample (nt,): what rounding is multiplied by.

    ``condition``: of the platform's equations for the driving forces, moments over the longest lever of a pin; NaN
    unless N fits.  ``undetermined``: one of these equations vanishes for every leg.  ``sin_q_n``: the smallest of the
    legs (planar: 1, no base turns there).  ``reach``: largest distance of a pin from the world's origin, or `a` if
    that is longer, over the shortest leg or the longest lever on the platform, whichever is shorter.
    """

    condition: np.ndarray
    undetermined: np.ndarray
    sin_q_n: np.ndarray
    reach: np.ndarray


def _require_length(scene: Scene, r: np.ndarray, L: np.ndarray) -> None:
    """A leg far shorter than its rod's tip or its lever on the platform is no leg, and q_s = L - a has no digits."""
    least = 1e-3 * np.maximum(abs(scene.leg.a), np.linalg.norm(r, axis=2))
    sample, leg = (int(i) for i in np.unravel_index(int(np.argmin(L / np.maximum(least, 1e-300))), L.shape))
    if not L[sample, leg] > least[sample, leg]:
        limit = f"expected more than {least[sample, leg]:.3g} m, a thousandth of a or of its lever on the platform"
        raise SingularPose(sample, leg + 1, "length", float(L[sample, leg]), limit)


def conditioning(
    scene: Scene, position: np.ndarray, R: np.ndarray, inverse: bool = True, regular: bool = True
) -> Conditioning:
    """Conditioning of poses (nt, 3), (nt, 3, 3); without `inverse` that for the driving forces is not asked for.

    Raises
    ------
    SingularPose
        A leg has hardly any length, or, if poses have to be `regular`, the condition is above 1e12.
    """
    pins = np.array(scene.hull.pins)
    r = np.einsum("tij,nj->tni", R, np.array(scene.pins))
    l = position[:, None] - pins + r
    L = np.linalg.norm(l, axis=2, keepdims=True)
    _require_length(scene, r, L[..., 0])
    lever = longest_lever(scene.pins)
    shortest = L.min(axis=(1, 2)) if scene.freedom == "point" else np.minimum(L.min(axis=(1, 2)), lever)
    fixed = max(float(np.linalg.norm(pins, axis=1).max()), abs(scene.leg.a))
    farthest = np.maximum(fixed, np.linalg.norm(pins + l, axis=2).max(axis=1))
    spatial = scene.freedom == "spatial"
    sin_q_n = (np.hypot(l[..., 0], l[..., 2]) / L[..., 0]).min(axis=1) if spatial else np.ones(len(l))
    condition, undetermined = np.full(len(l), np.nan), np.zeros(len(l), dtype=bool)
    if scene.platform_equations == scene.N and inverse:
        y = l / L
        rows = {"spatial": [0, 1, 2, 3, 4, 5], "planar": [0, 1, 5], "point": [0, 1]}[scene.freedom]
        A, condition, leg = conditioned(np.concatenate([y, np.cross(r, y)], axis=2).transpose(0, 2, 1)[:, rows], lever)
        if not spatial:
            condition, undetermined = without_vanishing_row(A, condition)
        if regular:
            require_regular(condition, leg)
    return Conditioning(condition, undetermined, sin_q_n, farthest / shortest)
