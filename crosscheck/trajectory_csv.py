"""Reading a trajectory file: columns, numbers and the lines that they stand in, or an error that names the place."""

from __future__ import annotations

import csv
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from ..models.explain import show
from ..models.reading import printable, short
from ..models.tables import LARGEST

POSE = ("t", "p_x", "p_y", "p_z", "q_w", "q_x", "q_y", "q_z")
RATES = ("v_x", "v_y", "v_z", "w_x", "w_y", "w_z", "a_x", "a_y", "a_z", "alpha_x", "alpha_y", "alpha_z")

MOST_ROWS = 1_000_000
"""The trajectory alone takes 0.6 kB a row, in all the processes of a run."""

LONGEST_LINE = 10_000
"""Characters; twenty numbers take some five hundred."""


class TrajectoryError(ValueError):
    """A trajectory that cannot be used: the message names the file, the row or field, what was got and expected."""


def _require_columns(file: str, names: list[str]) -> None:
    repeated = sorted({name for name in names if names.count(name) > 1})
    unknown = sorted(set(names) - {*POSE, *RATES})
    missing = [name for name in wanted_columns(names) if name not in names]
    for problem, columns in (("repeated", repeated), ("unknown", unknown), ("missing", missing)):
        if columns:
            listed = short(", ".join(map(repr, columns)), 200)
            raise TrajectoryError(
                f"{file}: got {problem} columns {listed}; expected {', '.join(POSE)} and, all or none,"
                f" {', '.join(RATES)}"
            )


def wanted_columns(names: list[str]) -> tuple[str, ...]:
    """Columns that a header with these names needs: the poses, and every rate if there is one."""
    return (*POSE, *RATES) if set(names) & set(RATES) else POSE


def _lines(file: str, text: TextIO) -> Iterator[str]:
    """Lines of a file that may have no end, or one line that has none."""
    number = 0
    while line := text.readline(LONGEST_LINE):
        number += 1
        if len(line) == LONGEST_LINE:
            raise TrajectoryError(f"{file}: line {number}: got {LONGEST_LINE} characters and more, expected fewer")
        yield line


def read_columns(path: Path) -> tuple[list[str], np.ndarray, list[int]]:
    """Column names, numbers (nt, columns) and line numbers of a CSV file. Raises TrajectoryError."""
    file = printable(path)
    try:
        with open(path, encoding="utf-8-sig") as text:
            return _columns(file, csv.reader(_lines(file, text), strict=True))
    except UnicodeDecodeError:
        raise TrajectoryError(f"{file}: got bytes that are no text, expected a CSV file in UTF-8") from None
    except csv.Error as e:
        raise TrajectoryError(f"{file}: got no CSV, expected a trajectory: {short(str(e), 200)}") from None
    except TrajectoryError:
        raise
    except (OSError, ValueError) as e:  # a path with a null byte is the latter
        raise TrajectoryError(f"{file}: {getattr(e, 'strerror', None) or e}, expected a readable CSV file") from None


def _columns(file: str, rows: Any) -> tuple[list[str], np.ndarray, list[int]]:
    """The same of a reader of rows."""
    header = next((row for row in rows if row), None)
    if header is None:
        raise TrajectoryError(f"{file}: got an empty file, expected a header {', '.join(POSE)}, ...")
    names = [name.strip() for name in header]
    _require_columns(file, names)
    values, lines = array("d"), array("q")
    for row in rows:
        if not row:
            continue
        if len(lines) == MOST_ROWS:
            raise TrajectoryError(f"{file}: got more than {MOST_ROWS} rows, expected fewer")
        lines.append(rows.line_num)
        if len(row) != len(names):
            raise TrajectoryError(
                f"{file}: line {lines[-1]}: got {len(row)} fields, expected {len(names)} as in the header"
            )
        for name, cell in zip(names, row, strict=True):
            try:
                value = float(cell.replace("_", "?"))  # Python alone would read 1_0 as 10
            except ValueError:
                value = np.nan
            if not abs(value) <= LARGEST:
                raise TrajectoryError(
                    f"{file}: line {lines[-1]}: {name}: got {show(cell.strip())}, expected a finite number up to"
                    f" {LARGEST:g}"
                )
            values.append(value)
    return names, np.array(values).reshape(-1, len(names)), lines.tolist()
