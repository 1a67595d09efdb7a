"""What pydantic found wrong with a scene, in the words of this project: field, what was got, what is expected."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from .tables import LARGEST


def show(value: Any) -> str:
    """A value for a message, cut where it is long."""
    text = repr(value) if not isinstance(value, dict) else "a table"
    return text if len(text) <= 60 else text[:57] + "..."


def explain(error: ValidationError) -> list[str]:
    """One line per wrong field: its path, what was got, what is expected."""
    lines = []
    for e in error.errors():
        field = ""
        for part in e["loc"]:
            field += f"[{part}]" if isinstance(part, int) else f".{part}" if field else str(part)
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
    return lines
