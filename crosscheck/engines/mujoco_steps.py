"""MuJoCo's own solver and its own way of going on in time, with what is global in MuJoCo: callbacks."""

from __future__ import annotations

import contextlib
import copy
import functools
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ..engine import EngineError
from ..kkt import State
from ..problem import Problem, Staged

if TYPE_CHECKING:
    from .mujoco_ import MujocoEngine

CALLBACKS = ("act_bias", "act_dyn", "act_gain", "contactfilter", "control", "passive", "sensor", "time")


@contextlib.contextmanager
def only(mj: Any, control: Callable[[Any, Any], None] | None = None) -> Iterator[None]:
    """No callback but this one; somebody else's would add forces of its own. All are put back after."""
    before = [(put, f) for get, put in _hooks(mj) if (f := get()) is not None]
    try:
        for put, _ in before:
            put(None)
        if control:
            mj.set_mjcb_control(control)
        yield
    finally:
        if control:
            mj.set_mjcb_control(None)
        for put, f in before:
            put(f)


@functools.cache
def _hooks(mj: Any) -> list[tuple[Callable[[], Any], Callable[[Any], None]]]:
    """What gets and what sets every callback."""
    return [(getattr(mj, f"get_mjcb_{name}"), getattr(mj, f"set_mjcb_{name}")) for name in CALLBACKS]


def require_connected(engine: MujocoEngine) -> None:
    """Raise EngineError unless the equalities join tips and pins: an anchor of a body is taken from the pose qpos0."""
    mj, m = engine.mj, engine.model
    joined = [m.eq_type, m.eq_objtype, m.eq_obj1id, m.eq_obj2id]
    for i, pair in enumerate(zip(engine.tips, engine.pins, strict=True)):
        want = [mj.mjtEq.mjEQ_CONNECT, mj.mjtObj.mjOBJ_SITE, *pair]
        if i >= m.neq or [int(x[i]) for x in joined] != [int(x) for x in want]:
            raise EngineError(
                f"{engine.name}: equality {i + 1} is not a connect of the sites tip{i + 1} and pin{i + 1}"
            )


def require_motors(engine: MujocoEngine) -> None:
    """Raise EngineError unless motors give the force that they are told to: MuJoCo clamps in silence."""
    mj, m = engine.mj, engine.model
    d, most = mj.MjData(m), np.linspace(0.5, 1.0, engine.scene.na) * mj.mjMAXVAL
    mj.mj_fwdPosition(m, d)
    for F in (most, -most):
        d.ctrl[engine.motors] = F
        mj.mj_fwdActuation(m, d)
        wrong = np.flatnonzero(d.qfrc_actuator != engine.layout.pushes[0] @ F)
        if len(wrong):
            joint = m.joint(m.dof_jntid[wrong[0]]).name
            want = float(engine.layout.pushes[0][wrong[0]] @ F)
            raise EngineError(
                f"{engine.name}: joint {joint}: got {d.qfrc_actuator[wrong[0]]:g} N from the motors, expected {want:g}"
                " N: the model limits or scales them"
            )


def forward(engine: MujocoEngine, state: State, F: np.ndarray) -> Iterator[Any]:
    """``mj_forward`` of every sample: forces on the motors, the load among the applied forces, soft loops."""
    mj, m, d, scene = engine.mj, engine.soft_model, engine.soft_data, engine.scene
    beyond = np.argwhere(np.abs(F) > mj.mjMAXVAL)
    if len(beyond):
        k, i = beyond[0].tolist()
        raise EngineError(
            f"{engine.name}: sample {k}: got {F[k, i]:.3g} N for leg {i + 1}, expected at most {mj.mjMAXVAL:g} N:"
            " MuJoCo sets all controls to zero beyond"
        )
    m.eq_solimp[:, :2] = engine.impedance
    m.opt.tolerance = engine.tolerance
    mj.mj_resetData(m, d)  # the solver starts from what it last found
    for k in range(len(F)):
        d.qpos, d.qvel, d.ctrl[engine.motors] = state.q[k], state.v[k], F[k]
        if scene.load:
            mj.mj_fwdPosition(m, d)
            d.qfrc_applied = engine.load(d)
        mj.mj_forward(m, d)
        engine.require_rows(d)
        yield d
    engine.require_quiet(d)


def own_steps(engine: MujocoEngine, problem: Problem, F: Staged, steps: int) -> State:
    """``mj_step``, forces and load set by its control callback, which every stage calls.

    Soft loops sag by (1 - d) timeconst^2 of the acceleration that loads them: of second order, as the time constant
    is so many steps.  Raises EngineError for one below two steps, which MuJoCo takes for two.
    """
    if not (got := engine.time_constant) >= 2.0:
        raise EngineError(f"{engine.name}: time constant: got {got:g} steps, expected 2 or more: it takes 2 for less")
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

    with only(mj, control):
        for k in range(1, n):
            d.time = problem.grid[k - 1]  # not the sum of so many steps
            for _ in range(steps):
                mj.mj_step(m, d)
            engine.require_quiet(d)
            engine.require_rows(d)
            q[k], v[k] = d.qpos, d.qvel
    return State(q, v, np.zeros_like(v))
