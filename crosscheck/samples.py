"""Every number of every engine as a table in long form: one row per time, leg, quantity and component."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..models.scene import Scene
from .compare import certified, forward_quantities, values
from .engine import HULL, DynamicsResult, Failure, Key
from .trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd

_Column = tuple[str, str, np.ndarray, np.ndarray]
"""Quantity, component, values and radii (nt, legs)."""


def components(scene: Scene, name: str) -> str:
    """Components that a vector quantity has: in the plane x_r y_r forces lie in it, and moments are along z_r."""
    if scene.topology == "spatial":
        return "xyz"
    return "xy" if name.startswith("F") or name == "a" else "z"


def samples(
    scene: Scene, trajectory: Trajectory, results: Mapping[Key, DynamicsResult | Failure]
) -> Iterator[pd.DataFrame]:
    """Every number of every engine at the compared samples in long form, one row per component, an engine at a time.

    Hull and platform are leg 0.
    """
    for (name, _), result in results.items():
        if not isinstance(result, Failure):
            yield _samples(scene, name, result, trajectory.t[result.samples])


def _samples(scene: Scene, name: str, result: DynamicsResult, t: np.ndarray) -> pd.DataFrame:
    import pandas as pd

    def vectors(quantities: Sequence[str]) -> list[_Column]:
        columns: list[_Column] = []
        for q in quantities:
            if result.radius:
                x, r = certified(scene, result, q)
            else:
                x = values(scene, result, q)
                r = np.full_like(x, np.nan)
            axes = components(scene, q) if x.shape[2] == 3 else "-"
            for axis in axes:
                k = 0 if axis == "-" else "xyz".index(axis)
                columns.append((q, axis, x[..., k], r[..., k]))
        return columns

    if result.platform is not None:  # the driving forces were handed in
        of_legs, of_none = vectors(scene.quantities[1:]), vectors((*HULL, *forward_quantities(scene)))
    else:
        scalars = (("L", result.L), ("dL", result.dL), ("power", result.F * result.dL))
        of_legs = [*vectors(scene.quantities), *((q, "-", x, _radius_beside(q, result, x)) for q, x in scalars)]
        of_none = vectors(HULL)
    parts = [_long(t, scene.legs, of_legs), _long(t, (0,), of_none)]
    return pd.concat(parts, ignore_index=True).assign(engine=name, route=result.route)


def _long(t: np.ndarray, legs: Sequence[int], columns: Sequence[_Column]) -> pd.DataFrame:
    """One row per time, leg and column."""
    import pandas as pd

    names, axes, values, radii = zip(*columns, strict=True)
    shape = (len(t), len(legs), len(columns))
    return pd.DataFrame(
        {
            "t": np.broadcast_to(t[:, None, None], shape).ravel(),
            "leg": np.broadcast_to(np.array(legs)[None, :, None], shape).ravel(),
            "quantity": np.broadcast_to(np.array(names), shape).ravel(),
            "component": np.broadcast_to(np.array(axes), shape).ravel(),
            "value": np.stack(values, axis=2).ravel(),
            "radius": np.stack(radii, axis=2).ravel(),
        }
    )


def _radius_beside(name: str, result: DynamicsResult, x: np.ndarray) -> np.ndarray:
    """Radius of L, dL and of the power F dL (a product of two balls, and its rounding)."""
    if not result.radius:
        return np.full_like(x, np.nan)
    if name != "power":
        return result.radius[name]
    F, dL, r_F, r_dL = result.F, result.dL, result.radius["F"], result.radius["dL"]
    return (np.abs(F) * r_dL + np.abs(dL) * r_F + r_F * r_dL + np.abs(x) * np.finfo(float).eps) * (1 + 1e-12)
