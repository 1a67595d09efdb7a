"""Reading a trajectory file: columns, numbers and the lines that they stand in, or an error that names the place."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from ..models.scene import printable
from ..models.tables import LARGEST

POSE = ("t", "p_x", "p_y", "p_z", "q_w", "q_x", "q_y", "q_z")
RATES = ("v_x", "v_y", "v_z", "w_x", "w_y", "w_z", "a_x", "a_y", "a_z", "alpha_x", "alpha_y", "alpha_z")


class TrajectoryError(ValueError):
    """A trajectory that cannot be used: the message names the file, the row or field, what was got and expected."""


def _require_columns(file: str, names: list[str]) -> None:
    repeated = sorted({name for name in names if names.count(name) > 1})
    unknown = sorted(set(names) - {*POSE, *RATES})
    missing = [name for name in wanted_columns(names) if name not in names]
    for problem, columns in (("repeated", repeated), ("unknown", unknown), ("missing", missing)):
        if columns:
            raise TrajectoryError(
                f"{file}: got {problem} columns {', '.join(map(repr, columns))}; expected {', '.join(POSE)} and, all or"
                f" none, {', '.join(RATES)}"
            )


def wanted_columns(names: list[str]) -> tuple[str, ...]:
    """Columns that a header with these names needs: the poses, and every rate if there is one."""
    return (*POSE, *RATES) if set(names) & set(RATES) else POSE


def read_columns(path: Path) -> tuple[list[str], np.ndarray, list[int]]:
    """Column names, numbers (nt, columns) and line numbers of a CSV file. Raises TrajectoryError."""
    file = printable(path)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as e:
        raise TrajectoryError(f"{file}: got bytes that are no text (at {e.start}), expected a CSV file") from None
    except (OSError, ValueError) as e:
        raise TrajectoryError(f"{file}: {getattr(e, 'strerror', None) or e}, expected a readable CSV file") from None
    try:
        lines = [(number, row) for number, row in enumerate(csv.reader(text.splitlines(), strict=True), 1) if row]
    except csv.Error as e:
        raise TrajectoryError(f"{file}: got no CSV, expected a trajectory: {e}") from None
    if not lines:
        raise TrajectoryError(f"{file}: got an empty file, expected a header {', '.join(POSE)}, ...")
    names = [name.strip() for name in lines[0][1]]
    _require_columns(file, names)
    values = []
    for number, row in lines[1:]:
        if len(row) != len(names):
            raise TrajectoryError(
                f"{file}: line {number}: got {len(row)} fields, expected {len(names)} as in the header"
            )
        for name, cell in zip(names, row, strict=True):
            try:
                value = float(cell.replace("_", "?"))  # Python alone would read 1_0 as 10
            except ValueError:
                value = np.nan
            if not abs(value) <= LARGEST:
                raise TrajectoryError(
                    f"{file}: line {number}: {name}: got {cell.strip()!r}, expected a finite number up to {LARGEST:g}"
                )
            values.append(value)
    return names, np.array(values).reshape(-1, len(names)), [number for number, _ in lines[1:]]
