"""Files gone wrong, for Hypothesis: texts whose words are replaced, dropped, repeated or swapped, and broken bytes."""

from __future__ import annotations

import math
import re
from functools import cache

from hypothesis import strategies as st

WORD = re.compile(r'"[^"\n]*"|[A-Za-z_]\w*|[-+.\w]+|[^\s]|\n')
"""Of TOML and CSV: strings, names, numbers, brackets, and the ends of lines."""

NESTED = "a." * 2000 + "a"

WORDS = [
    # numbers at the edge of float64, of a file's limits, and of what is a number at all
    "nan", "-nan", "inf", "-inf", "1e308", "-1e308", "1e400", "5e-324", "-0.0", "0", "-1", "1e20", "1.1e20", "-1e20",
    "9223372036854775808", "9" * 400, "9" * 5000, "0x" + "f" * 300, "0x" + "f" * 5000, "0b101", "1_0", "1__0", "0o7",
    # other types
    "true", "[]", "{}", "[[]]", "[[[1.0]]]", "[1.0, 2.0]", "[1.0, 2.0, 3.0, 4.0]", "{ a = 1 }", '""', '"0.5"', "''",
    "1979-05-27T07:32:00Z", "07:32:00", "1979-05-27", '[1, "a", {}]', "{ c0 = nan, terms = [[1.0]] }",
    # text that means something elsewhere
    '"<script>alert(1)</script>"', '"../../etc/passwd"', '"a\\u0000b"', '"a\\nb"', '"\\u001b[31m"', '"\\u202egnirts"',
    '"[red]x[/]"', '"%s%n{0}"', "'''\nx\n'''", '"' + "x" * 10_000 + '"', '"\U0001f600"', '"a b"', '"x" * 3',
    # keys and headers
    "mass", '"\\u001b[31m"', '"a\\nb"', '"<b>"', "x" * 10_000, "leg.guide.mass", NESTED, "[leg]", "[[leg]]",
    "[motion.orientation]", "[leg.base]", "\n[load]\nforce = [0.0, 0.0, 0.0]\n", "\n[initial]\n", "\n[extra]\n", "=",
    "\nextra = 1\n", "\nschema = 2\n", "\n" + "".join(f"k{i} = {i}\n" for i in range(300)), "J_z = 1.0", "J_x",
    # depth and length
    "[" * 3000, "[" * 500 + "]" * 500, "{ a = " * 500 + "1" + " }" * 500, "{ " + NESTED + " = 1 }",
    "[{ " + NESTED + " = 1 }]", "[" + "[0.0, 0.0, 0.0]," * 2000 + "]", "[" + "1.0," * 20_000 + "]",
    # what is no text of its kind
    "\x00", "\x1b[2J", "\x7f", "\r", "\r\n", "\u2028", "\ufeff", "#", '"', "'", "\\", ",", ",,", "]", "}", "\n",
]  # fmt: skip
"""What a word is replaced by."""

SCRAPS = [
    b"\x00",
    b"\xff",
    b"\xfe\xff",
    b"\xc3",
    b"\xed\xa0\x80",
    b"\xef\xbb\xbf",
    b"\r\n",
    b"\r",
    b"\x1b[31m",
    b"\x80",
]


@cache
def _words(text: str) -> list[str]:
    return WORD.findall(text)


def _choices(*counts: int) -> st.SearchStrategy[list[int]]:
    """One of each number of things, in a single draw, which takes far longer than what is done with it."""

    def split(n: int) -> list[int]:
        found = []
        for count in counts:
            n, k = divmod(n, count)
            found.append(k)
        return found

    return st.integers(0, math.prod(counts) - 1).map(split)


@st.composite
def mutated(draw: st.DrawFn, texts: list[str]) -> bytes:
    """One of the texts with one to three words changed."""
    words = _words(draw(st.sampled_from(texts))).copy()
    for kind, word, at, more in draw(st.lists(_choices(8, len(WORDS), 4096, 64), min_size=1, max_size=3)):
        if not words:
            break
        i = at % len(words)
        if kind < 4:
            words[i] = WORDS[word]
        elif kind == 4:
            del words[i]
        elif kind == 5:
            words[i:i] = words[i : i + 1 + more % 12]
        elif kind == 6:
            j = (i + more) % len(words)
            words[i], words[j] = words[j], words[i]
        else:
            del words[i : i + 1 + more % 40]
    return " ".join(words).encode("utf-8", "surrogatepass")


@st.composite
def broken(draw: st.DrawFn, texts: list[str]) -> bytes:
    """One of the texts with some of its bytes flipped, cut, repeated or put in."""
    data = bytearray(draw(st.sampled_from(texts)).encode())
    for kind, i, j, k in draw(st.lists(_choices(5, 2048, 2048, 80), min_size=1, max_size=4)):
        first, last = sorted((i % (len(data) + 1), j % (len(data) + 1)))
        if kind == 0 and first < len(data):
            data[first] ^= 1 << k % 8
        elif kind == 1:
            del data[first : min(last, first + k)]
        elif kind == 2:
            data[first:first] = data[first:last]
        elif kind == 3:
            data[first:first] = SCRAPS[k % len(SCRAPS)]
        elif kind == 4:
            data = data.replace(b"\n", b"\r\n")
    return bytes(data)
