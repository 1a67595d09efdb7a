"""The history of nights: one folder per night, sealed, so that a truncated or edited file is found and named."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from .checks import CHECK_COLUMNS, CHECK_KEY, RANK, TIME_COLUMNS, TIME_KEY

if TYPE_CHECKING:
    import pandas as pd

KIND = "nightly"
"""``kind`` in the run.json of a night: other commands lay their folders beside it."""

MOST = 60
"""Earlier nights that are read."""

CHECKS, TIMES, INFO = "checks.csv", "times.csv", "run.json"
NUMBERS = ("error", "tolerance", "floor", "margin", "us_per_sample", "yardstick_us", "ratio")
REPETITION_KEY = [*TIME_KEY, "unit"]
_FACTS: dict[str, type | tuple[type, ...]] = {
    "run_id": str, "started": str, "versions": dict, "code": dict, "machine": dict, "units": (dict, list),
    "files": dict,
}  # fmt: skip
_PROCESSOR = ("processor", "model", "usable_cores")
_UNPRINTABLE = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff\ufffe\uffff]")


class HistoryError(ValueError):
    """A night that cannot be read or accepted: names the folder, the file, what was found and what is expected."""


class Night(NamedTuple):
    """The tables of a night, of checks and of times (`reports.checks`), and what is in run.json."""

    folder: Path
    checks: pd.DataFrame
    times: pd.DataFrame
    info: dict[str, Any]

    @property
    def name(self) -> str:
        """Of its folder, and the run_id if that is another one."""
        run_id = self.info["run_id"]
        return run_id if self.folder.name == run_id else f"{self.folder.name} ({run_id})"


def printable(text: str) -> str:
    """The text in one line: what a file or a terminal could stumble over is written as an escape."""
    return _UNPRINTABLE.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def processor(info: Mapping[str, Any]) -> str:
    """What times depend on: nights on different processors have no times in common."""
    return ", ".join(str(info["machine"].get(fact, "")) for fact in _PROCESSOR) + " cores"


def night_files(
    checks: pd.DataFrame, times: pd.DataFrame, info: Mapping[str, Any], more: Mapping[str, str], digits: int = 6
) -> dict[str, str]:
    """The texts of a night's files by name, `more` among them, run.json with the digests of all of them last.

    Raises HistoryError for tables that could not be read back.
    """
    texts = {CHECKS: _csv(checks, CHECK_COLUMNS, digits), TIMES: _csv(times, TIME_COLUMNS, digits), **more}
    texts = {name: text.encode("utf-8", "backslashreplace").decode() for name, text in texts.items()}
    facts = json.loads(json.dumps({**info, "files": {name: _sha256(text.encode()) for name, text in texts.items()}}))
    facts["files"][INFO] = _seal(facts)
    texts[INFO] = json.dumps(facts, indent=2, allow_nan=False) + "\n"
    night_of(Path(str(info.get("run_id", KIND))), texts)
    return texts


def night_of(folder: Path, texts: Mapping[str, str]) -> Night:
    """The night that texts of `night_files` hold. Raises HistoryError, which names `folder`."""
    return _night(folder, _facts(folder, texts[INFO].encode()), {n: text.encode() for n, text in texts.items()})


def load_night(folder: Path) -> Night:
    """Read a night, or the accepted baseline. Raises HistoryError if a file is not as it was written."""
    info = _facts(folder, _bytes(folder, INFO))
    for name in info["files"]:
        if name != Path(name).name:
            raise HistoryError(f"{folder}: {INFO}: files: got {name!r}, expected names of files in this folder")
    return _night(folder, info, {name: _bytes(folder, name) for name in (CHECKS, TIMES, *info["files"])})


def earlier(history: Path, than: str) -> tuple[list[Night], list[str]]:
    """Nights of a folder that started before the time `than` (ISO 8601), newest first, at most `MOST` of them.

    Also what to tell of entries that look like a night and cannot be read. Unfinished nights (hidden) and folders of
    other commands are none.
    """
    begun: list[tuple[datetime, Path]] = []
    unread: list[str] = []
    try:
        entries = sorted(entry for entry in history.iterdir() if not entry.name.startswith("."))
    except OSError as e:
        return [], [f"{history}: {e.strerror or e}, expected a folder of nights"]
    for entry in entries:
        try:
            started = _started(entry)
        except HistoryError as e:
            unread.append(str(e))
        else:
            if started is not None and started < _time(history, than):
                begun.append((started, entry))
    nights = []
    for _, folder in sorted(begun, reverse=True):
        if len(nights) == MOST:
            break
        try:
            night = load_night(folder)
        except HistoryError as e:
            unread.append(str(e))
            continue
        twin = next((n.folder for n in nights if n.info["run_id"] == night.info["run_id"]), None)
        if twin is None:
            nights.append(night)
        else:
            unread.append(f"{folder}: {INFO}: run_id: got that of {twin}, expected another: it counts once")
    return nights, unread


def _csv(table: pd.DataFrame, columns: Sequence[str], digits: int) -> str:
    import pandas as pd

    missing = [name for name in columns if name not in table]
    if missing:
        raise HistoryError(f"a table of a night: got no column {missing[0]!r}, expected {', '.join(columns)}")
    shown = {
        name: table[name].astype(float)
        if name in NUMBERS
        else ["" if pd.isna(value) else printable(str(value)) for value in table[name]]
        for name in columns
    }
    return pd.DataFrame(shown).to_csv(index=False, float_format=f"%.{digits}g", lineterminator="\n")


def _started(folder: Path) -> datetime | None:
    """When a night began; None for an entry that does not look like one. Raises HistoryError."""
    looks = f"-{KIND}-" in folder.name
    if not looks and not os.path.isfile(folder / INFO):
        return None
    content = _bytes(folder, INFO)
    if not looks and _json(folder, content).get("kind") != KIND:
        return None
    return _time(folder, _facts(folder, content)["started"])


def _bytes(folder: Path, name: str) -> bytes:
    path = folder / name
    try:
        if path.exists() and not path.is_file():  # a pipe would wait for ever
            raise HistoryError(f"{folder}: {name}: got something else, expected a file")
        return path.read_bytes()
    except OSError as e:
        raise HistoryError(f"{folder}: {name}: {e.strerror or e}, expected a file of a finished night") from None


def _json(folder: Path, content: bytes) -> dict[str, Any]:
    try:
        found = json.loads(content)
    except (ValueError, RecursionError) as e:
        raise HistoryError(f"{folder}: {INFO}: got no JSON ({e}), expected that of a finished night") from None
    if not isinstance(found, dict):
        raise HistoryError(f"{folder}: {INFO}: got {type(found).__name__}, expected an object")
    return found


def _facts(folder: Path, content: bytes) -> dict[str, Any]:
    """What run.json holds, of the types that it must have, and as it was sealed. Raises HistoryError."""
    info = _json(folder, content)
    if info.get("kind") != KIND:
        raise HistoryError(f"{folder}: {INFO}: kind: got {info.get('kind')!r}, expected {KIND!r}: a folder of a night")
    for name, kind in _FACTS.items():
        if not isinstance(info.get(name), kind):
            raise HistoryError(f"{folder}: {INFO}: {name}: got {info.get(name)!r}, expected what a night has there")
    _time(folder, info["started"])
    if info["files"].get(INFO) != _seal(info):
        raise HistoryError(f"{folder}: {INFO}: got other facts than were written, expected those of its digest")
    return info


def _time(folder: Path, text: str) -> datetime:
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        found = None
    if found is None or found.tzinfo is None:
        raise HistoryError(f"{folder}: {INFO}: started: got {text!r}, expected a date and time with its zone")
    return found


def _seal(info: Mapping[str, Any]) -> str:
    """Digest of run.json but for this digest."""
    files = {name: digest for name, digest in info["files"].items() if name != INFO}
    return _sha256(json.dumps({**info, "files": files}, sort_keys=True).encode())


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _night(folder: Path, info: dict[str, Any], contents: Mapping[str, bytes]) -> Night:
    for name, content in contents.items():
        if name != INFO and info["files"].get(name) != _sha256(content):
            raise HistoryError(f"{folder}: {name}: got {len(content)} bytes that differ from what was written")
    times = _table(folder, TIMES, contents[TIMES], TIME_COLUMNS, REPETITION_KEY)
    return Night(folder, _checks(folder, contents[CHECKS]), times, info)


def require_tables(folder: Path, checks: pd.DataFrame, times: pd.DataFrame) -> None:
    """Raise HistoryError unless a night could hold these rows."""
    _checks(folder, _csv(checks, CHECK_COLUMNS, 6).encode())
    _table(folder, TIMES, _csv(times, TIME_COLUMNS, 6).encode(), TIME_COLUMNS, REPETITION_KEY)


def _checks(folder: Path, content: bytes) -> pd.DataFrame:
    checks = _table(folder, CHECKS, content, CHECK_COLUMNS, CHECK_KEY)
    unknown = checks[~checks["verdict"].isin(RANK)]
    if len(unknown):
        raise HistoryError(
            f"{folder}: {CHECKS}: verdict of {name_of(unknown.iloc[0], CHECK_KEY)}: got"
            f" {unknown['verdict'].iloc[0]!r}, expected one of {', '.join(RANK)}"
        )
    return checks


def _table(folder: Path, name: str, content: bytes, columns: list[str], key: list[str]) -> pd.DataFrame:
    """A table of texts as they are ("NA" is a text), and of numbers. Raises HistoryError."""
    import pandas as pd

    try:
        header, *rows = csv.reader(io.StringIO(content.decode(), newline=""), strict=True)
    except (csv.Error, ValueError) as e:  # ValueError: no text, or no line at all
        raise HistoryError(f"{folder}: {name}: got no table ({e}), expected columns {', '.join(columns)}") from None
    if header != columns:
        raise HistoryError(f"{folder}: {name}: got columns {', '.join(header)}, expected {', '.join(columns)}")
    for line, row in enumerate(rows, 2):
        if len(row) != len(columns):
            raise HistoryError(f"{folder}: {name}: row {line}: got {len(row)} fields, expected {len(columns)}")
    table = pd.DataFrame(rows, columns=columns, dtype=str)
    for column in (c for c in columns if c in NUMBERS):
        numbers = pd.to_numeric(table[column], errors="coerce").astype(float)
        wrong = table[(numbers.isna() & (table[column] != "")) | (numbers < 0.0)]
        if len(wrong):
            raise HistoryError(
                f"{folder}: {name}: {column} of {name_of(wrong.iloc[0], key)}: got {wrong[column].iloc[0]!r}, expected"
                " a number that is not negative, or nothing"
            )
        table[column] = numbers
    twice = table[table.duplicated(key)]
    if len(twice):
        raise HistoryError(f"{folder}: {name}: got {name_of(twice.iloc[0], key)} twice, expected one row of each")
    return table


def name_of(row: Mapping[str, Any] | pd.Series, key: Sequence[str]) -> str:
    """What a row is about, for people."""
    return " ".join(str(row[name]) for name in key if row[name])
