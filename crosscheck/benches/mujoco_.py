"""MuJoCo over the hardness of its loops (solimp); in time over integrator, step and time constant (solref)."""

from __future__ import annotations

from ..kkt_sweep import KktSweep, Knob

SWEEP = KktSweep(
    "mujoco",
    solver=[Knob(f"mj_forward, solimp {d:g}", {"impedance": d}) for d in (0.9, 0.99, 0.999, 0.9999)],
    own={
        "mj_step RK4": [
            *(Knob("solref 2 dt", {"integrator": "RK4", "time_constant": 2.0}, steps) for steps in (5, 10, 20, 40)),
            *(Knob("solref 8 dt", {"integrator": "RK4", "time_constant": 8.0}, steps) for steps in (10, 40)),
        ],
        "mj_step Euler": [Knob("solref 2 dt", {"integrator": "Euler"}, steps) for steps in (10, 40, 160)],
        "mj_step implicitfast": [Knob("solref 2 dt", {"integrator": "implicitfast"}, steps) for steps in (10, 40, 160)],
    },
)
