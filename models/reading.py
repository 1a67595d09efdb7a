"""Reading what others wrote: bounded files, TOML that cannot take hours, and text that a terminal may be shown."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

MOST_PARTS = 8
"""Of a dotted key; a scene has three. Python's reader takes their square: a minute for fifty thousand."""

_QUOTED = re.compile(r'"""[\s\S]*?"""|"(?:\\.|[^"\\\n])*+"' r"|'''[\s\S]*?'''|'[^'\n]*+'" r"|#[^\n]*+")
"""Strings and comments."""

_TOO_DOTTED = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{MOST_PARTS}}}")


def printable(text: str | Path) -> str:
    """A path or a text on one line, for messages and tables: what is no visible character is spelled out."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(text))


def short(text: str, most: int = 60) -> str:
    """The same, cut where it is long."""
    text = printable(text)
    return text if len(text) <= most else text[: most - 3] + "..."


def read_text(path: Path, most: int) -> str:
    """Text of a UTF-8 file of at most so many bytes: also of a pipe, and of a device that never ends.

    Raises OSError, or ValueError that says what was got.
    """
    with open(path, "rb") as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise ValueError(f"got more than {most / 1e6:g} MB")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as e:
        raise ValueError(f"got bytes that are no text (at {e.start})") from None


def read_toml(text: str) -> dict[str, Any]:
    """Tables of a TOML text. Raises ValueError that says what is wrong."""
    if found := _TOO_DOTTED.search(_QUOTED.sub("s", text)):
        raise ValueError(f"a key of more than {MOST_PARTS} parts, {short(found[0])}")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("brackets too deep") from None
    except ValueError as e:  # broken TOML, an integer beyond Python's limits
        raise ValueError(short(str(e), 200)) from None
