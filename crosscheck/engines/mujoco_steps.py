"""MuJoCo's own way of going on in time."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

import numpy as np

from ..kkt import State
from ..problem import Problem, Staged

if TYPE_CHECKING:
    from .mujoco_ import MujocoEngine


def own_steps(engine: MujocoEngine, problem: Problem, F: Staged, steps: int) -> State:
    """``mj_step``, forces and load set by its control callback, which every stage calls.

    Soft loops sag by (1 - d) timeconst^2 of the acceleration that loads them: of second order, as the time constant
    is so many steps.
    """
    mj, m = engine.mj, copy.copy(engine.model)
    m.opt.integrator = getattr(mj.mjtIntegrator, f"mjINT_{engine.integrator.upper()}")
    m.opt.timestep, m.opt.tolerance = F.dt, engine.tolerance
    m.opt.disableflags |= mj.mjtDisableBit.mjDSBL_AUTORESET
    m.eq_solimp[:, :2], m.eq_solref[:] = engine.impedance, (engine.time_constant * F.dt, 1.0)
    d = mj.MjData(m)
    start = engine.state(problem.start)
    d.qpos, d.qvel = start.q[0], start.v[0]
    n = len(problem.grid)
    q, v = np.empty((n, m.nq)), np.empty((n, m.nv))
    q[0], v[0] = d.qpos, d.qvel

    def control(_: Any, d: Any) -> None:
        d.ctrl[engine.motors] = F(d.time)
        if engine.scene.load:
            d.qfrc_applied = engine.load(d)

    before = mj.get_mjcb_control()
    mj.set_mjcb_control(control)
    try:
        for k in range(1, n):
            d.time = problem.grid[k - 1]  # not the sum of so many steps
            for _ in range(steps):
                mj.mj_step(m, d)
            engine.require_quiet(d)
            engine.require_rows(d)
            q[k], v[k] = d.qpos, d.qvel
    finally:
        mj.set_mjcb_control(before)
    return State(q, v, np.zeros_like(v))
