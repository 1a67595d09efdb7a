"""Every number of every engine as a table in long form: one row per time, leg, quantity and component."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from ..models.scene import Scene
from .compare import certified, forward_quantities, values
from .engine import HULL, DynamicsResult, Failure, Key
from .trajectory import Trajectory

SAMPLE_COLUMNS = ("engine", "route", "t", "leg", "quantity", "component", "value", "radius")

BLOCK = 2000
"""Trajectory rows per block of the samples table."""

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
    """Every number of every engine in long form, one row per component, in blocks; hull and platform are leg 0."""
    for (name, _), result in results.items():
        if isinstance(result, Failure):
            continue
        for start in range(0, len(result.samples), BLOCK):
            block = slice(start, start + BLOCK)
            yield _samples(scene, name, result, trajectory.t[result.samples[block]], block)


def _samples(scene: Scene, name: str, result: DynamicsResult, t: np.ndarray, block: slice) -> pd.DataFrame:
    platform = None if result.platform is None else result.platform[block]
    part = replace(result, F=result.F[block], reactions=result.reactions[block], platform=platform)

    def vectors(quantities: Sequence[str]) -> list[_Column]:
        columns: list[_Column] = []
        for q in quantities:
            if result.radius:
                x, r = (v[block] for v in certified(scene, result, q))
            else:
                x = values(scene, part, q)
                r = np.full_like(x, np.nan)
            axes = components(scene, q) if x.shape[2] == 3 else "-"
            for axis in axes:
                k = 0 if axis == "-" else "xyz".index(axis)
                columns.append((q, axis, x[..., k], r[..., k]))
        return columns

    if platform is not None:  # the driving forces were handed in
        of_legs, of_none = vectors(scene.quantities[1:]), vectors((*HULL, *forward_quantities(scene)))
    else:
        scalars = (("L", result.L[block]), ("dL", result.dL[block]), ("power", result.F[block] * result.dL[block]))
        of_legs = [*vectors(scene.quantities), *((q, "-", x, _radius_beside(q, result, block, x)) for q, x in scalars)]
        of_none = vectors(HULL)
    parts = [_long(t, scene.legs, of_legs), _long(t, (0,), of_none)]
    return pd.concat(parts, ignore_index=True).assign(engine=name, route=result.route)[[*SAMPLE_COLUMNS]]


def _long(t: np.ndarray, legs: Sequence[int], columns: Sequence[_Column]) -> pd.DataFrame:
    """One row per time, leg and column."""
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


def _radius_beside(name: str, result: DynamicsResult, block: slice, x: np.ndarray) -> np.ndarray:
    """Radius of L, dL and of the power F dL (a product of two balls, and its rounding)."""
    if not result.radius:
        return np.full_like(x, np.nan)
    if name != "power":
        return result.radius[name][block]
    F, dL = result.F[block], result.dL[block]
    r_F, r_dL = result.radius["F"][block], result.radius["dL"][block]
    return (np.abs(F) * r_dL + np.abs(dL) * r_F + r_F * r_dL + np.abs(x) * np.finfo(float).eps) * (1 + 1e-12)
