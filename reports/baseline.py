"""The accepted baseline: a night in the tree that later ones are compared with."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .checks import CHECK_KEY, RED
from .files import OutputError
from .history import (
    CHECKS,
    INFO,
    REPETITION_KEY,
    HistoryError,
    Night,
    load_night,
    name_of,
    night_files,
    night_of,
    processor,
)

if TYPE_CHECKING:
    import pandas as pd

_FACTS = ("kind", "run_id", "started", "versions", "code", "machine")


def write_baseline(folder: Path, night: Night) -> None:
    """Accept a night: replace the files of the baseline. Rows of units that the night was not to run stay.

    A row that came out as before keeps the run_id that it was accepted with, so that a change is all that changes.
    Raises HistoryError for a night that holds red rows, OutputError where nothing can be written.
    """
    red = night.checks[night.checks["verdict"].isin(RED)]
    if len(red):
        raise HistoryError(
            f"{night.folder}: {CHECKS}: got {len(red)} red rows, the first {name_of(red.iloc[0], CHECK_KEY)};"
            " expected a night without any: a baseline holds nothing that failed"
        )
    units = list(night.info["units"])
    facts = {name: night.info[name] for name in _FACTS if name in night.info}
    made = night_of(folder, night_files(night.checks, night.times, {**facts, "units": units}, {}, digits=3))
    tables = made.checks, made.times
    if os.path.lexists(folder / INFO):
        old = load_night(folder)
        whole = night.info.get("whole", False)
        units += [unit for unit in old.info["units"] if whole and unit not in units]  # which there are no more
        if processor(old.info) != processor(night.info) and not old.times["unit"].isin(units).all():
            raise HistoryError(
                f"{night.folder}: {INFO}: machine: got {processor(night.info)}, expected {processor(old.info)}, which"
                " the baseline has times of that this night did not measure: run every unit to accept another machine"
            )
        tables = _merged(old.checks, made.checks, units), _merged(old.times, made.times, units)
        units = [*night.info["units"], *(unit for unit in old.info["units"] if unit not in units)]
    checks, times = (t.sort_values(key) for t, key in zip(tables, (CHECK_KEY, REPETITION_KEY), strict=True))
    _replace(folder, night_files(checks, times, {**facts, "units": sorted(units)}, {}, digits=3))


def _merged(old: pd.DataFrame, new: pd.DataFrame, units: Sequence[str]) -> pd.DataFrame:
    import pandas as pd

    same = [name for name in new.columns if name != "run_id"]
    since = new[same].merge(old, on=same, how="left")["run_id"].to_numpy()
    run_id = new["run_id"].mask(pd.notna(since), pd.Series(since, index=new.index))
    rows = new.assign(run_id=run_id)
    return pd.concat([old[~old["unit"].isin(units)], rows], ignore_index=True)


def _replace(folder: Path, texts: Mapping[str, str]) -> None:
    """Put files in the place of others, the digests last: what a power cut leaves is whole, or is found out."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".new-", dir=folder) as staging:
            for name, text in texts.items():
                with open(Path(staging, name), "w", encoding="utf-8", newline="") as file:
                    file.write(text)
                    file.flush()
                    os.fsync(file.fileno())
            for name in texts:
                os.replace(Path(staging, name), folder / name)
    except OSError as e:
        raise OutputError(f"{folder}: {e.strerror or e}, expected a folder that can be written to") from None
