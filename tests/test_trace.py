"""Traced numbers: what they leave out, what they share, and that the program says what the text says."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from conftest import one_sample

from stewart_crosscheck.analytic.evaluate import DRIVING_FORCES, FORWARD_DYNAMICS, INVERSE_DYNAMICS, Problem
from stewart_crosscheck.analytic.solve import eliminate, ordered_numbers
from stewart_crosscheck.analytic.trace import Program, Trace, Traced, program
from stewart_crosscheck.analytic.traced import traced
from stewart_crosscheck.crosscheck.trajectory import from_scene
from stewart_crosscheck.models import load_scene, scene_names

OPERATIONS = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "neg": lambda a: -a,
    "sqrt": math.sqrt,
    "abs": abs,
    "larger": lambda a, b: a > b,
    "select": lambda c, a, b: a if c else b,
}


def run(p: Program, inputs: Any) -> list[float]:
    """The program on plain floats."""
    values: list[Any] = []
    for name, operands, value in p.operations:
        if name in ("number", "parameter"):
            values.append(value)
        elif name == "input":
            values.append(inputs[int(value)])
        else:
            values.append(OPERATIONS[name](*(values[i] for i in operands)))
    return [values[k] for k in p.results]


def names(p: Program) -> list[str]:
    return [op.name for op in p.operations if op.operands]


@pytest.fixture
def xy() -> tuple[Trace, Traced, Traced]:
    trace = Trace()
    return trace, trace.input(0), trace.input(1)


@pytest.mark.parametrize(
    ("text", "left"),
    [
        (lambda x, y: x + 0.0, []),
        (lambda x, y: 0.0 + x, []),
        (lambda x, y: x - 0.0, []),
        (lambda x, y: 0.0 - x, ["neg"]),
        (lambda x, y: 1.0 * x, []),
        (lambda x, y: x * 0.0 + y, []),
        (lambda x, y: x / 1.0, []),
        (lambda x, y: 0.0 / x + y, []),
        (lambda x, y: 0.0 - (0.0 - x), []),
        (lambda x, y: x + -y, ["-"]),
        (lambda x, y: -x + y, ["-"]),
        (lambda x, y: x - (-y), ["+"]),
        (lambda x, y: -x * y + x, ["*", "-"]),
        (lambda x, y: (-x) * (-y), ["*"]),
        (lambda x, y: -x / y, ["/", "neg"]),
        (lambda x, y: x * y + y * x, ["*", "+"]),
        (lambda x, y: (x - y) * (y - x), ["-", "*", "neg"]),
        (lambda x, y: (x + 1.0) / y + x / y, ["/", "*", "*", "+", "+"]),
        (lambda x, y: x / (2.0 * 3.0), ["/"]),
        (lambda x, y: abs(x - y), ["-", "abs"]),
    ],
)
def test_what_need_not_be_done_is_left_out(text: Any, left: list[str], xy: tuple[Trace, Traced, Traced]) -> None:
    trace, x, y = xy
    p = program(trace, [text(x, y)])
    assert sorted(names(p)) == sorted(left)
    for values in ((1.7, 0.3), (-2.1, 5.5), (0.25, -3.0)):
        assert run(p, values) == [pytest.approx(text(*values), rel=1e-15)]


def test_numbers_that_do_not_move_are_worked_out_and_zero_is_left_out(xy: tuple[Trace, Traced, Traced]) -> None:
    trace, x, _ = xy
    m, a, none = trace.parameter(2.5), trace.parameter(0.5), trace.parameter(0.0)
    p = program(trace, [x * (m * a) + none * x, x / none if none > 0 else x])
    assert names(p) == ["*"]
    assert p.parameters == [1.25]
    assert run(p, [3.0]) == [3.75, 3.0]
    assert names(program(trace, [x * (m * (a - 0.1))])) == []  # 1.0


def test_a_branch_on_what_moves_is_refused(xy: tuple[Trace, Traced, Traced]) -> None:
    trace, x, _ = xy
    assert trace.parameter(1.0) > 0
    with pytest.raises(TypeError, match="must not branch"):
        _ = x > 0


def test_counts_are_of_what_is_needed(xy: tuple[Trace, Traced, Traced]) -> None:
    trace, x, y = xy
    unused = x * y * y
    counts = program(trace, [trace.sqrt(x * x + y * y) / y]).counts()
    assert (counts["*"], counts["+"], counts["/"], counts["sqrt"], counts["flops"]) == (2, 1, 1, 1, 5)
    assert program(trace, [unused]).counts()["flops"] == 2


def test_traced_elimination_exchanges_rows() -> None:
    rng = np.random.default_rng(1)
    trace = Trace()
    x = [trace.input(k) for k in range(12)]
    found, determinant = eliminate([x[0:3], x[3:6], x[6:9]], x[9:12], trace.ordered)
    p = program(trace, [*found, abs(determinant)])
    for _ in range(20):
        values = rng.normal(size=12)
        values[rng.integers(0, 9)] = 0.0
        A, b = values[:9].reshape(3, 3), values[9:]
        *got, size = run(p, values)
        np.testing.assert_allclose(got, np.linalg.solve(A, b), rtol=1e-11)
        assert size == pytest.approx(abs(np.linalg.det(A)))
        same, _ = eliminate(A.tolist(), b.tolist(), ordered_numbers)
        np.testing.assert_allclose(got, same, rtol=1e-12)


@pytest.mark.parametrize("problem", [DRIVING_FORCES, INVERSE_DYNAMICS, FORWARD_DYNAMICS], ids=lambda p: p.name)
@pytest.mark.parametrize("name", [name for name in scene_names() if name != "collinear"])
def test_the_program_says_what_the_text_says(name: str, problem: Problem) -> None:
    scene = load_scene(name)
    P, motion = scene.parameters, from_scene(scene, 7).motion
    rng = np.random.default_rng(5)
    p = traced(P, problem)
    for k in range(7):
        x = np.concatenate([np.ravel(np.asarray(a)) for a in one_sample(motion, k)])
        if problem is FORWARD_DYNAMICS:
            x = np.concatenate([x[:18], 100.0 * rng.normal(size=len(P.p))])
        assert len(x) == sum(problem.widths(P))
        wanted, regularity = problem.evaluate(P, x.tolist(), math.sqrt, ordered_numbers)
        *got, sure = run(p, x)
        assert len(wanted) == len(problem.rows(P))
        # another order of sums, and reciprocals: a few roundings of the largest number, times a condition of the masses
        few = 4e-15 if problem is not FORWARD_DYNAMICS else 4e-14
        np.testing.assert_allclose(got, wanted, rtol=0, atol=few * np.abs(wanted).max())
        assert sure == pytest.approx(regularity, rel=1e-10)
