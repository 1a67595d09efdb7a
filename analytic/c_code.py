"""A traced program as C: one function for blocks of samples, one for a single sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from .trace import Program

TILE = 32
"""Samples that the inner loop takes at a time: their results, 37 kB of a hexapod, stay in the cache until written."""

_EXPRESSIONS = {
    "+": "{} + {}",
    "-": "{} - {}",
    "*": "{} * {}",
    "/": "{} / {}",
    "neg": "-{}",
    "sqrt": "__builtin_sqrt({})",
    "abs": "__builtin_fabs({})",
    "larger": "{} > {}",
    "select": "{} ? {} : {}",
}

_FRAME = """\
#include <string.h>
#ifdef __SSE2__
#include <emmintrin.h>
#endif
enum {{ TILE = {tile}, INPUTS = {inputs}, WIDEST = {widest}, RESULTS = {results} }};
static const long row[RESULTS] = {{ {rows} }};

static void tile(const double *restrict x, double *restrict y, double *restrict regularity, const double *restrict p)
{{
  for (int i = 0; i < TILE; i++) {{
{tile_body}
  }}
}}

/* TILE samples of WIDTH numbers each as columns of x; adds 0 times each number, which is 0 if all are finite. */
#define TAKE(WIDTH) \
  static void take_##WIDTH(const double *restrict a, double *restrict x, double *restrict nothing) \
  {{ \
    for (int j = 0; j < WIDTH; j++) \
      for (int i = 0; i < TILE; i++) {{ \
        x[j * TILE + i] = a[i * WIDTH + j]; \
        nothing[i] += 0.0 * a[i * WIDTH + j]; \
      }} \
  }}
{takes}

/* The same for n samples of an input from sample k on, the last one again to the end of the tile. */
static const double *from(const double *a, int width, long k, long n, double *padded)
{{
  if (n >= TILE)
    return a + k * width;
  for (int i = 0; i < TILE; i++)
    memcpy(padded + i * width, a + (k + (i < n ? i : n - 1)) * width, width * sizeof(double));
  return padded;
}}

static void give(const double *from, double *to, long n, int stream)
{{
#ifdef __SSE2__
  if (stream) {{
    for (int i = 0; i < TILE; i += 2)
      _mm_stream_pd(to + i, _mm_load_pd(from + i));
    return;
  }}
#endif
  (void) stream;
  memcpy(to, from, n * sizeof(double));
}}

/* Results of n samples, row by row, so many numbers from row to row; whether all are finite and as regular as asked. */
int block(long n, const double *const *given, double *out, long line, const double *p, double regular)
{{
  _Alignas(64) double x[INPUTS * TILE], y[RESULTS * TILE], regularity[TILE], nothing[TILE], padded[WIDEST * TILE];
  const int large = n * RESULTS > 1 << 17 && line % 2 == 0 && (size_t) out % 16 == 0;
  int sure = 1;
  for (long k = 0; k < n; k += TILE) {{
    const long m = n - k < TILE ? n - k : TILE;
    memset(nothing, 0, sizeof nothing);
{taken}
    tile(x, y, regularity, p);
    for (int r = 0; r < RESULTS; r++) {{
      for (int i = 0; i < TILE; i++)
        nothing[i] += 0.0 * y[r * TILE + i];
      give(y + r * TILE, out + row[r] * line + k, m, large && m == TILE);
    }}
    for (int i = 0; i < TILE; i++)
      sure &= regularity[i] + nothing[i] >= regular;
  }}
#ifdef __SSE2__
  _mm_sfence();
#endif
  return sure;
}}

/* One sample: inputs one after another, results in their order; returns the regularity, or not a number if one
   of them is none. */
double one(const double *restrict x, double *restrict y, const double *restrict p)
{{
  double nothing = 0.0;
  for (int k = 0; k < INPUTS; k++)
    nothing += 0.0 * x[k];
{one_body}
  for (int k = 0; k < RESULTS; k++)
    nothing += 0.0 * y[k];
  return regularity + nothing;
}}
"""


def _body(program: Program, load: Callable[[int], str], store: Callable[[int, str], str]) -> str:
    names: list[str] = []
    lines: list[str] = []
    parameters = 0
    for k, (name, operands, value) in enumerate(program.operations):
        if name == "number":
            names.append(f"({value!r})")
        elif name == "parameter":
            names.append(f"p[{parameters}]")
            parameters += 1
        else:
            what = load(int(value)) if name == "input" else _EXPRESSIONS[name].format(*(names[i] for i in operands))
            names.append(f"t{k}")
            lines.append(f"    const {'int' if name == 'larger' else 'double'} t{k} = {what};")
    lines += [f"    {store(n, names[k])}" for n, k in enumerate(program.results)]
    return "\n".join(lines)


def c_code(program: Program, rows: Sequence[int], widths: Sequence[int]) -> str:
    """Source of ``block`` and ``one`` for a program whose results are those of ``rows`` and, last, the regularity."""
    last = len(rows)

    def of_tile(n: int, value: str) -> str:
        return f"regularity[i] = {value};" if n == last else f"y[{n} * TILE + i] = {value};"

    def of_one(n: int, value: str) -> str:
        return f"const double regularity = {value};" if n == last else f"y[{n}] = {value};"

    return _FRAME.format(
        tile=TILE,
        inputs=sum(widths),
        widest=max(widths),
        takes="\n".join(f"TAKE({width})" for width in sorted(set(widths))),
        taken="\n".join(
            f"    take_{width}(from(given[{n}], {width}, k, m, padded), x + {sum(widths[:n])} * TILE, nothing);"
            for n, width in enumerate(widths)
        ),
        results=last,
        rows=", ".join(map(str, rows)),
        tile_body=_body(program, lambda k: f"x[{k} * TILE + i]", of_tile),
        one_body=_body(program, lambda k: f"x[{k}]", of_one),
    )
