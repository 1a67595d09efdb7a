"""Result files, written whole or not at all."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pandas as pd

AGREEMENT_COLUMNS = [
    "run_id", "scene", "trajectory", "engine", "engine_version", "route", "setting", "quantity", "unit",
    "max_abs", "rms", "max_rel", "scale", "tolerance", "tolerance_name", "verdict", "us_per_sample",
]  # fmt: skip


class OutputError(ValueError):
    """A folder that results cannot go to: the message names it, what was found and what is expected."""


def require_free(folder: Path) -> None:
    """Raise OutputError unless `folder` can be made or is empty, before any long work starts."""
    try:
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"--out {folder}: got a file, expected a folder that does not exist or is empty")
        if folder.is_dir() and any(folder.iterdir()):
            raise OutputError(f"--out {folder}: the folder is not empty, expected one that does not exist or is empty")
        parent = folder.absolute().parent
        while not parent.exists():
            parent = parent.parent
        if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
            raise OutputError(f"--out {folder}: {parent} cannot be written to, expected a writable folder")
    except (OSError, ValueError) as e:
        if isinstance(e, OutputError):
            raise
        raise OutputError(
            f"--out {str(folder)!r}: {getattr(e, 'strerror', None) or e}, expected a folder name"
        ) from None


@contextlib.contextmanager
def _whole(folder: Path) -> Iterator[Path]:
    """A hidden folder beside `folder` to write into, renamed to `folder` in the end, removed if anything fails.

    Two runs into one folder: the one that comes second keeps its results beside, and says where.
    """
    require_free(folder)
    try:
        folder.absolute().parent.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.absolute().parent))
    except OSError as e:
        raise OutputError(f"--out {folder}: {e.strerror or e}; nothing was written") from None
    try:
        yield staging
        staging.chmod(0o755)
        try:
            staging.rename(folder)
        except OSError:
            beside = folder.with_name(f"{folder.name}{staging.name.removeprefix('.' + folder.name)}")
            staging.rename(beside)
            raise OutputError(
                f"--out {folder}: another run filled it meanwhile; the results of this one are in {beside}"
            ) from None
    except OSError as e:
        raise OutputError(f"--out {folder}: {e.strerror or e}; nothing was written") from None
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def write_files(folder: Path, texts: Mapping[str, str]) -> None:
    """Write text files by name into a folder that does not exist or is empty. Raises OutputError."""
    with _whole(folder) as staging:
        for name, text in texts.items():
            (staging / name).write_text(text, encoding="utf-8")


def write_run(folder: Path, agreement: pd.DataFrame, samples: Iterable[pd.DataFrame], info: Mapping[str, Any]) -> None:
    """agreement.csv, samples.csv (17 significant digits, block by block) and run.json. Raises OutputError."""
    with _whole(folder) as staging:
        agreement[AGREEMENT_COLUMNS].to_csv(staging / "agreement.csv", index=False)
        with open(staging / "samples.csv", "w", encoding="utf-8", newline="") as file:
            header = True
            for block in samples:
                block.to_csv(file, index=False, float_format="%.17g", header=header)
                header = False
            if header:
                file.write("engine,route,t,leg,quantity,component,value,radius\n")
        (staging / "run.json").write_text(json.dumps(info, indent=2) + "\n", encoding="utf-8")
