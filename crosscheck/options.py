"""Values of the command line: what is a number of samples, what a time."""

from __future__ import annotations

import math

import typer

from .problem import LONGEST
from .trajectory_csv import MOST_ROWS


def count(text: str, least: int = 1) -> int:
    """Value of --samples."""
    if not (text.isdecimal() and len(text) < 10 and least <= int(text) <= MOST_ROWS):
        raise typer.BadParameter(f"got {text!r}, expected a whole number from {least} to {MOST_ROWS}")
    return int(text)


def several(text: str) -> int:
    """Value of --samples of a simulation, which has a start and an end."""
    return count(text, least=2)


def seconds(text: str) -> float:
    """Value of --duration."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value <= LONGEST:
        raise typer.BadParameter(f"got {text!r}, expected seconds, more than 0 and at most {LONGEST:g}")
    return value
