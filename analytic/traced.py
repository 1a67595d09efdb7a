"""A problem of a machine as a program of operations, by running the text on traced numbers."""

from __future__ import annotations

import functools
from dataclasses import fields
from typing import Any

from .evaluate import Mechanism, Problem
from .stewart import Leg, Load, Parameters, PlanarParameters
from .trace import Program, Trace, program


@functools.lru_cache(maxsize=64)
def traced(P: Mechanism, problem: Problem) -> Program:
    """Operations from the problem's inputs, one after another, to its results and, last, the regularity."""
    trace = Trace()

    def vector(v: Any) -> Any:
        return tuple(trace.parameter(x) for x in v)

    common: dict[str, Any] = {
        "leg": Leg(**{f.name: trace.parameter(getattr(P.leg, f.name)) for f in fields(Leg)}),
        "m_p": trace.parameter(P.m_p),
        "p": tuple(vector(p) for p in P.p),
        "O": tuple(vector(O) for O in P.O),
        "g": vector(P.g),
        "load": Load(vector(P.load.force), vector(P.load.moment), vector(P.load.point)),
    }
    Q: Mechanism
    if isinstance(P, PlanarParameters):
        Q = PlanarParameters(**common, J_pz=None if P.J_pz is None else trace.parameter(P.J_pz))
    else:
        Q = Parameters(**common, I_p=(vector(P.I_p[0]), vector(P.I_p[1]), vector(P.I_p[2])))
    inputs = [trace.input(k) for k in range(sum(problem.widths(P)))]
    results, regularity = problem.evaluate(Q, inputs, trace.sqrt, trace.ordered)
    return program(trace, [*results, regularity])
