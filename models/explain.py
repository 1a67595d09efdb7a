"""What pydantic found wrong with a scene, in the words of this project: field, what was got, what is expected."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from .reading import short
from .tables import LARGEST

MOST_LINES = 10
"""Of a message."""


def show(value: Any) -> str:
    """A value for a message, cut where it is long."""
    if isinstance(value, dict):
        return "a table"
    try:
        return short(repr(value))
    except (RecursionError, ValueError):  # arrays of tables of tables ..., an integer beyond what Python writes
        return "a value too long to be shown"


def explain(error: ValidationError) -> list[str]:
    """One line per wrong field: its path, what was got, what is expected; no more of them than anybody reads."""
    lines = []
    errors = error.errors(include_url=False)
    for e in errors[:MOST_LINES]:
        field = ""
        for part in e["loc"]:
            field += f"[{part}]" if isinstance(part, int) else f".{short(part)}" if field else short(part)
        kind = e["type"]
        if kind == "extra_forbidden":
            lines.append(f"{field}: unknown key, expected none of this name")
        elif kind == "missing":
            lines.append(f"{field}: got nothing, expected " + ("one entry more" if field.endswith("]") else "this key"))
        elif kind == "greater_than_equal" and e.get("ctx", {}).get("ge") == 0:
            lines.append(f"{field}: got {show(e['input'])}, expected zero or more")
        elif kind in ("less_than_equal", "greater_than_equal"):
            lines.append(f"{field}: got {show(e['input'])}, expected a number up to {LARGEST:g}")
        elif kind == "model_type":
            lines.append(f"{field}: got {show(e['input'])}, expected a table")
        elif kind == "string_pattern_mismatch":
            lines.append(f"{field}: got {show(e['input'])}, expected a letter, then up to 63 letters, digits, _ and -")
        elif kind == "value_error":
            reason = str(e.get("ctx", {})["error"])
            lines.append(f"{field}.{reason}" if field else reason)
        elif kind in ("too_short", "too_long"):
            ctx = e.get("ctx", {})
            expected = f"at most {ctx['max_length']}" if kind == "too_long" else f"at least {ctx['min_length']}"
            lines.append(f"{field}: got {ctx['actual_length']} entries, expected {expected}")
        else:
            reason = e["msg"].replace("Input should be", "").strip().replace("a valid tuple", "an array")
            lines.append(f"{field}: got {show(e['input'])}, expected {reason}")
    if len(errors) > MOST_LINES:
        lines.append(f"{len(errors) - MOST_LINES} fields more are not as expected")
    return lines
