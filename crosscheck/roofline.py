"""What one core of this machine can do at most, measured in the same run as everything else."""

from __future__ import annotations

import ctypes
import timeit
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from ..analytic.compiler import library

CHAINS = 12
"""Independent chains of fused multiply-adds of 8 numbers each: enough to hide their latency in two units."""

STEPS = 1 << 18
MEMORY = 1 << 25
"""Numbers written and read, 256 MB: more than any cache holds."""

REPEATS = 7

_SOURCE = """\
#ifdef __SSE2__
#include <emmintrin.h>
#endif
typedef double lanes __attribute__((vector_size(64)));

double multiply(long n)
{
  const lanes b = { 0.9, 0.9, 0.9, 0.9, 0.9, 0.9, 0.9, 0.9 };
  DECLARE
  for (long i = 0; i < n; i++) {
    STEP
  }
  const lanes sum = SUM;
  return sum[0] + sum[1] + sum[2] + sum[3] + sum[4] + sum[5] + sum[6] + sum[7];
}

void store(double *a, long n)
{
#ifdef __SSE2__
  for (long i = 0; i + 1 < n; i += 2)
    _mm_stream_pd(a + i, _mm_set1_pd(1.0));
  _mm_sfence();
#else
  for (long i = 0; i < n; i++)
    a[i] = 1.0;
#endif
}

double load(const double *a, long n)
{
  lanes sum[4] = { { 0 } };
  for (long i = 0; i + 31 < n; i += 32)
    for (int k = 0; k < 4; k++)
      sum[k] += *(const lanes *) (a + i + 8 * k);
  const lanes all = sum[0] + sum[1] + sum[2] + sum[3];
  return all[0] + all[1] + all[2] + all[3] + all[4] + all[5] + all[6] + all[7];
}
"""


class Roofline(NamedTuple):
    """Of one core: products per second, each fused with a sum or not, and bytes written past the cache and read."""

    products: float
    stored: float
    loaded: float

    def seconds(self, counts: Mapping[str, int], read: int, written: int) -> float:
        """Least time of one sample [s]: that of its products, or of its bytes, whichever is larger.

        The bound of this sequence of operations, not of every way to the same numbers: sums that fuse with no product,
        divisions and roots have units of their own.
        """
        return max(counts["*"] / self.products, read / self.loaded + written / self.stored)


def _best(call: Callable[..., object], *args: object) -> float:
    return min(timeit.repeat(lambda: call(*args), number=1, repeat=REPEATS))


def measure() -> Roofline:
    """Measure this core, about half a second. Raises NoCompiler."""
    names = [f"a{k}" for k in range(CHAINS)]
    code = library(
        _SOURCE.replace("DECLARE", " ".join(f"lanes {a} = b * {k}.0;" for k, a in enumerate(names)))
        .replace("STEP", " ".join(f"{a} = {a} * b + b;" for a in names))
        .replace("SUM", " + ".join(names))
    )
    code.multiply.restype = code.load.restype = ctypes.c_double
    space = np.ones(MEMORY + 8)
    first = (-space.ctypes.data // space.itemsize) % 8  # whole cache lines
    at, n = ctypes.c_void_p(space[first:].ctypes.data), ctypes.c_long(MEMORY)
    return Roofline(
        products=8.0 * CHAINS * STEPS / _best(code.multiply, ctypes.c_long(STEPS)),
        stored=8.0 * MEMORY / _best(code.store, at, n),
        loaded=8.0 * MEMORY / _best(code.load, at, n),
    )
