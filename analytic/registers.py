"""The back end `numpy`: the traced operations as NumPy calls on registers, which are used again and again.

Run directly on arrays, the text makes a new array for every operation, works on what vanishes, and does twice what it
names twice.  Its trace does each thing once, and its registers are written to as often as there are operations.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from .evaluate import REGULAR, Mechanism, Problem
from .samples import BLOCK
from .trace import FIXED, Program
from .traced import traced

_CALLS: dict[str, Callable[..., Any]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "neg": np.negative,
    "sqrt": np.sqrt,
    "abs": np.abs,
}


def allocation(program: Program) -> tuple[list[int], int]:
    """Register of every operation, and how many there are: one is free again after the last use of its number.

    Numbers that do not move need none; theirs is -1.
    """
    operations = program.operations
    last = {i: k for k, op in enumerate(operations) for i in op.operands}
    last |= dict.fromkeys(program.results, len(operations))
    registers: list[int] = []
    free: list[int] = []
    count = 0
    for k, op in enumerate(operations):
        if op.name in FIXED:
            registers.append(-1)
        elif free and op.operands:
            registers.append(free.pop())
        else:
            registers.append(count)
            count += 1
        # Only now: a selection writes its result before it has read all of its operands.
        free.extend(registers[i] for i in set(op.operands) if last[i] == k and registers[i] >= 0)
    return registers, count


class Bound(NamedTuple):
    """Calls with the arrays that they read and, last, write; ``inputs`` and ``results`` are among these arrays."""

    calls: list[tuple[Callable[..., Any], tuple[np.ndarray, ...]]]
    inputs: dict[int, np.ndarray]
    results: list[np.ndarray]


@functools.lru_cache(maxsize=32)
def bound(P: Mechanism, problem: Problem, n: int, thread: int) -> Bound:
    """The program of a machine on registers of n samples, which belong to one thread."""
    program = traced(P, problem)
    registers, count = allocation(program)
    space = np.empty((count, n))
    bits = space.view(np.int64)
    at: list[np.ndarray] = []
    calls: list[tuple[Callable[..., Any], tuple[np.ndarray, ...]]] = []
    for op, register in zip(program.operations, registers, strict=True):
        out = space[register]
        at.append(np.array(op.value) if op.name in FIXED else out)
        operands = [at[i] for i in op.operands]
        if op.name == "larger":  # all bits set, or none
            calls += [(np.greater, (*operands, out)), (np.negative, (out, out)), (_as_bits, (out, bits[register]))]
        elif op.name == "select":  # b ^ ((a ^ b) & condition), which needs no array beside the result
            condition, a, b = (x.view(np.int64) for x in operands)
            x = bits[register]
            calls += [(np.bitwise_xor, (a, b, x)), (np.bitwise_and, (x, condition, x)), (np.bitwise_xor, (x, b, x))]
        elif op.operands:
            calls.append((_CALLS[op.name], (*operands, out)))
    inputs = {int(op.value): at[k] for k, op in enumerate(program.operations) if op.name == "input"}
    return Bound(calls, inputs, [at[k] for k in program.results])


def _as_bits(x: np.ndarray, out: np.ndarray) -> None:
    """The numbers -1.0 and -0.0 as integers -1 and 0."""
    np.copyto(out, x, casting="unsafe")


class NumPy:
    """Arrays of samples, in blocks that stay in the cache."""

    size = BLOCK

    def __init__(self, P: Mechanism, problem: Problem) -> None:
        self.P, self.problem, self.rows = P, problem, problem.rows(P)

    def fill(self, inputs: Sequence[np.ndarray], numbers: np.ndarray) -> bool:
        """All samples at once."""
        n = numbers.shape[1]
        ready = bound(self.P, self.problem, n, threading.get_ident())
        columns = np.hstack([a.reshape(n, -1) for a in inputs]).T
        for k, register in ready.inputs.items():
            register[:] = columns[k]
        *results, regularity = ready.results
        with np.errstate(all="ignore"):  # a vertical leg overflows; the regularity says so
            for call, arrays in ready.calls:
                call(*arrays)
            for row, x in zip(self.rows, results, strict=True):
                numbers[row] = x
            whole = sum(float(numbers[row].sum()) for row in self.rows) + columns.sum()  # a number, or one was none
        return bool(np.min(regularity) >= REGULAR) and bool(np.isfinite(whole))
