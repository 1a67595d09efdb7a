"""The inverse dynamics of a machine as a program of operations, by running the text on traced numbers."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from .evaluate import Mechanism, lever_unit, regular_numbers
from .stewart import Leg, Load, Parameters, PlanarParameters, PlatformMotion
from .trace import Program, Trace, program

INPUTS = 24
"""Numbers of a motion: C_p, R by rows, dC_p, w_p, ddC_p, dw_p."""


def traced(P: Mechanism, every: bool) -> Program:
    """Operations of the inverse dynamics of a machine: driving forces, or every number of `slots`; regularity last."""
    trace = Trace()

    def vector(v: Any) -> Any:
        return tuple(trace.parameter(x) for x in v)

    leg = Leg(**{f.name: trace.parameter(getattr(P.leg, f.name)) for f in fields(Leg)})
    load = Load(vector(P.load.force), vector(P.load.moment), vector(P.load.point))
    common: dict[str, Any] = {
        "leg": leg,
        "m_p": trace.parameter(P.m_p),
        "p": tuple(vector(p) for p in P.p),
        "O": tuple(vector(O) for O in P.O),
        "g": vector(P.g),
        "load": load,
    }
    Q: Mechanism
    if isinstance(P, PlanarParameters):
        Q = PlanarParameters(**common, J_pz=None if P.J_pz is None else trace.parameter(P.J_pz))
    else:
        Q = Parameters(**common, I_p=(vector(P.I_p[0]), vector(P.I_p[1]), vector(P.I_p[2])))
    x = [trace.input(k) for k in range(INPUTS)]
    C_p, *R, dC_p, w_p, ddC_p, dw_p = (tuple(x[k : k + 3]) for k in range(0, INPUTS, 3))
    motion = PlatformMotion(C_p, tuple(R), dC_p, w_p, ddC_p, dw_p)
    out, regularity = regular_numbers(Q, motion, trace.sqrt, trace.ordered, lever_unit(P), every)
    return program(trace, [*out, regularity])
