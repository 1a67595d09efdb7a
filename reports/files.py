"""Result files, written whole or not at all."""

from __future__ import annotations

import contextlib
import csv
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    import pandas as pd

AGREEMENT_COLUMNS = [
    "run_id", "scene", "trajectory", "engine", "engine_version", "route", "setting", "quantity", "unit",
    "max_abs", "rms", "max_rel", "scale", "tolerance", "tolerance_name", "verdict", "us_per_sample",
]  # fmt: skip

MARGIN_COLUMNS = ["engine", "route", "quantity", "margin", "verdict", "where", "reason"]
"""``margin``: the error over its tolerance where that is largest; empty if there is no error."""

SAMPLE_COLUMNS = ["engine", "route", "t", "leg", "quantity", "component", "value", "radius"]

SIMULATION_COLUMNS = [
    "run_id", "scene", "engine", "engine_version", "route", "setting", "integrator", "dt", "against", "pose_error",
    "rotation_error", "order", "judged_until", "loop_gap", "energy_defect", "wall_per_second", "a_error", "alpha_error",
    "growth_mean", "growth_max", "amplification", "tolerance_pose", "tolerance_rotation", "tolerance_name", "verdict",
    "wrong", "reason",
]  # fmt: skip


class OutputError(ValueError):
    """A folder that results cannot go to: the message names it, what was found and what is expected."""


def require_free(folder: Path) -> None:
    """Raise OutputError unless `folder` can be made or is empty, before any long work starts."""
    try:
        if os.path.lexists(folder) and not folder.is_dir():
            raise OutputError(f"--out {folder}: got a file, expected a folder that does not exist or is empty")
        if folder.is_dir() and any(folder.iterdir()):
            raise OutputError(
                f"--out {folder}: got a folder that is not empty, expected one that does not exist or is empty"
            )
        home = folder.absolute()
        while not os.path.lexists(home):
            home = home.parent
        with tempfile.TemporaryDirectory(prefix=_prefix(folder), dir=home):
            pass  # it can be written to: permissions alone do not say so
    except OSError as e:
        raise OutputError(f"--out {folder}: {e.strerror or e}, expected a folder that can be written to") from None


def _prefix(folder: Path) -> str:
    return f".{folder.name}-"


@contextlib.contextmanager
def _whole(folder: Path) -> Iterator[Path]:
    """A hidden folder to write into, which becomes `folder` in the end and is removed if anything fails.

    It lies beside `folder`, or in it if that exists: the current folder, a mount or a link stays what it is.
    Two runs into one folder: the one that comes second keeps its results in a folder of their own, and says where.
    """
    path = Path(os.path.realpath(folder))
    home = path if os.path.isdir(path) else path.parent
    made = [parent for parent in (home, *home.parents) if not os.path.exists(parent)]
    staging = None
    try:
        home.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=_prefix(path), dir=home))
        yield staging
        staging.chmod(0o755)
        for file in (*staging.iterdir(), staging):
            sync(file)
        try:
            _publish(staging, path)
        except OSError:
            kept = path.with_name(staging.name.removeprefix("."))
            try:
                staging.rename(kept)
            except OSError:  # beside a mount lies another file system
                kept = staging.with_name(kept.name)
                staging.rename(kept)
            raise OutputError(
                f"--out {folder}: another run filled it meanwhile; the results of this one are in {kept}"
            ) from None
        finally:
            for parent in (home, *(parent.parent for parent in made)):
                with contextlib.suppress(OSError):  # the results are there, whatever the system promises about them
                    sync(parent)
    except OSError as e:
        raise OutputError(f"--out {folder}: {e.strerror or e}; nothing was written") from None
    finally:
        if staging:
            shutil.rmtree(staging, ignore_errors=True)
        for parent in made:
            with contextlib.suppress(OSError):  # it holds the results
                parent.rmdir()


def sync(path: Path) -> None:
    """Wait until a file, or the list of a folder's entries, lies on the disk: a rename is not before what it names."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_whole(path: Path, text: str) -> None:
    """A text file that is there whole, or as it was before. Raises OSError."""
    temporary = path.with_name(f".{path.name}-{os.getpid()}")
    try:
        temporary.write_text(text, encoding="utf-8")
        sync(temporary)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
    sync(path.parent)


def _publish(staging: Path, folder: Path) -> None:
    """Rename `staging` to `folder`, or its files into the folder that it lies in. OSError if that has others."""
    if staging.parent != folder:
        staging.rename(folder)
        return
    if any(not entry.name.startswith(_prefix(folder)) for entry in folder.iterdir()):  # but for runs under way
        raise FileExistsError
    for file in staging.iterdir():
        file.rename(folder / file.name)


def write_files(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """Write texts and bytes by name into a folder that does not exist or is empty. Raises OutputError."""
    require_free(folder)
    with _whole(folder) as staging:
        for name, content in files.items():
            (staging / name).write_bytes(content if isinstance(content, bytes) else content.encode())


def write_run(folder: Path, agreement: pd.DataFrame, samples: Iterable[pd.DataFrame], info: Mapping[str, Any]) -> None:
    """agreement.csv, margins.csv, samples.csv (17 significant digits, block by block), run.json. Raises OutputError."""
    with _whole(folder) as staging:
        agreement[AGREEMENT_COLUMNS].to_csv(staging / "agreement.csv", index=False)
        margins = agreement.rename(columns={"share": "margin"})[MARGIN_COLUMNS]
        margins.to_csv(staging / "margins.csv", index=False)
        with open(staging / "samples.csv", "w", encoding="utf-8", newline="") as file:
            file.write(",".join(SAMPLE_COLUMNS) + "\n")
            for block in samples:
                _write_rows(file, block[SAMPLE_COLUMNS])
        (staging / "run.json").write_text(json.dumps(info, indent=2) + "\n", encoding="utf-8")


def _write_rows(file: TextIO, table: pd.DataFrame) -> None:
    """Rows of a CSV: floats with 17 significant digits, nothing for a NaN. `to_csv` takes twice as long."""

    def texts(column: pd.Series) -> list:
        values = column.tolist()
        return [f"{x:.17g}" if x == x else "" for x in values] if column.dtype.kind == "f" else values

    columns = (texts(table[name]) for name in table)
    csv.writer(file, lineterminator="\n").writerows(zip(*columns, strict=True))


def write_simulation(folder: Path, simulation: pd.DataFrame, states: pd.DataFrame, info: Mapping[str, Any]) -> None:
    """simulation.csv, states.csv (17 significant digits) and run.json. Raises OutputError."""
    with _whole(folder) as staging:
        simulation[SIMULATION_COLUMNS].to_csv(staging / "simulation.csv", index=False)
        states.to_csv(staging / "states.csv", index=False, float_format="%.17g")
        (staging / "run.json").write_text(json.dumps(info, indent=2) + "\n", encoding="utf-8")
