"""DART over its time step; in time also over its error reduction (ERP)."""

from __future__ import annotations

from ..kkt_sweep import KktSweep, Knob

SWEEP = KktSweep(
    "dart",
    solver=[Knob(f"two World.step, dt {dt:g} s", {"time_step": dt}) for dt in (1e-3, 1e-4, 1e-5, 1e-6)],
    own={
        "World.step": [
            Knob(f"ERP {reduction:g}", {"reduction": reduction}, steps)
            for reduction in (0.0, 0.2)
            for steps in (5, 25, 100)
        ]
    },
)
