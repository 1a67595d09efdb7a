"""Jacobians as DART gives them: the columns of each loop point's own chain side by side, rods first, then platform."""

from __future__ import annotations

import numpy as np

from ...models.scene import Scene
from .. import wrench
from ..layout import Layout


def column_count(scene: Scene) -> int:
    """Columns of all loop points."""
    return len(scene.coordinates) + scene.N * scene.platform_equations


def loop_rows(scene: Scene, layout: Layout, columns: np.ndarray) -> np.ndarray:
    """Loop rows (nt, nc, nv), rod's tip less platform's pin, from linear columns (nt, 3, n) in world axes."""
    nt, legs = len(columns), scene.nv - len(layout.platform)
    of_rods = columns[..., :legs].reshape(nt, 3, scene.N, -1)
    rows = np.zeros((nt, scene.N, 3, scene.nv))
    for i, chain in enumerate(layout.chains):
        rows[:, i][..., chain] = of_rods[:, :, i]
    rows[..., np.sort(layout.platform)] = -columns[..., legs:].reshape(nt, 3, scene.N, -1).transpose(0, 2, 1, 3)
    return rows[:, :, : len(scene.loop_axes)].reshape(nt, scene.nc, scene.nv)


def leg_axes(scene: Scene, columns: np.ndarray, tips: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (nt, nl, 3, 3) of the leg bodies and levers (nt, nl, 3) from the joints' points to the rods' tips.

    The hinge n turns about z of base and guide, the hinge o about y of the base, and the rod slides along its own y:
    the columns (nt, 6, n), angular and linear, are these axes.  ``getWorldTransform`` takes ten times as long.
    ``tips`` (N, 3): on the rods, from their centres of mass.
    """
    legs = columns[..., : len(scene.coordinates)].reshape(len(columns), 2, 3, scene.N, -1)
    angular, linear = legs.transpose(1, 4, 0, 3, 2)  # by the leg's coordinates, (nt, N, 3) each
    joints = [j for j in scene.joints if not j.cut]
    leg = [j.leg - 1 for j in joints]
    of_base, of_rod = (np.array([[j.child == f"{kind}{j.leg}"] for j in joints]) for kind in ("base", "rod"))
    z = angular[-2][:, leg]
    y = np.where(of_base, angular[0][:, leg], linear[-1][:, leg])
    R = np.stack([wrench.moment(y, z), y, z], axis=-1)
    whole = wrench.moment(linear[-2], angular[-2])[:, leg]  # (z x lever) x z
    return R, np.where(of_rod, np.einsum("tnij,nj->tni", R, tips[leg]), whole)
