"""The back end `compiled`: a problem of a machine traced, written as C and compiled.

Numbers of a machine are arguments of the compiled code; which of them are 0, 1 or equal shapes it.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import numpy as np

from .c_code import c_code
from .compiler import library
from .evaluate import REGULAR, Mechanism, Problem
from .traced import traced


class Compiled:
    """A problem of a machine in machine code. Raises NoCompiler.

    ``one(x, y, parameters)`` takes pointers and answers a single sample without overhead, see `ControlLoop`.
    """

    size = 1 << 14

    def __init__(self, P: Mechanism, problem: Problem) -> None:
        written = traced(P, problem)
        self.rows = problem.rows(P)
        code = library(c_code(written, self.rows, problem.widths(P)))
        self.parameters = np.array([*written.parameters, 0.0])
        self._block = code.block
        self._block.argtypes = [ctypes.c_long, *[ctypes.c_void_p] * 2, ctypes.c_long, ctypes.c_void_p, ctypes.c_double]
        self.one = ctypes.PyDLL(code._name, handle=code._handle).one  # shorter than letting other threads run
        self.one.restype = ctypes.c_double

    def fill(self, inputs: Sequence[np.ndarray], numbers: np.ndarray) -> bool:
        """All samples at once."""
        n = numbers.shape[1]
        if numbers.strides[1] != numbers.itemsize or numbers.strides[0] % numbers.itemsize or not numbers.flags.aligned:
            out = np.empty((len(numbers), n))
            sure = self.fill(inputs, out)
            numbers[self.rows] = out[self.rows]
            return sure
        arrays = [np.ascontiguousarray(a) for a in inputs]
        pointers = (ctypes.c_void_p * len(arrays))(*(a.ctypes.data for a in arrays))
        line = numbers.strides[0] // numbers.itemsize
        return bool(self._block(n, pointers, numbers.ctypes.data, line, self.parameters.ctypes.data, REGULAR))
