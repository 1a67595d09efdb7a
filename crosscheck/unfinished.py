"""A night under way: a hidden folder beside the one that it becomes, in which every finished unit has its record.

Whatever ends the night early, what has a record is kept.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import AwareDatetime, BaseModel, Field, ValidationError

from ..reports import OutputError, require_free
from ..reports.files import sync, write_whole
from .limited import INTERRUPTS, held

PLAN, LOCK, RECORD, UNITS = "plan.json", "lock", "unit.json", "units"
SUFFIX = ".unfinished"


class Plan(BaseModel):
    """What a night was begun as: versions, code and machine stay the same all night long."""

    run_id: str
    started: AwareDatetime
    units: Annotated[list[str], Field(min_length=1)]
    whole: bool
    baseline: Path
    versions: dict[str, str | None]
    code: dict[str, str]
    machine: dict[str, Any]


class Attempt(BaseModel):
    """How a command ended (see `supervise.Outcome`), and the engines that crashed in it."""

    how: str
    status: int
    seconds: float
    reason: str
    crashed: list[str]


class Record(BaseModel):
    """A unit that has ended: the last attempt counts."""

    attempts: Annotated[list[Attempt], Field(min_length=1)]

    @property
    def seconds(self) -> float:
        """Of all attempts."""
        return sum(attempt.seconds for attempt in self.attempts)


class ResumeError(ValueError):
    """Nothing to resume, or what was begun cannot be gone on with: the message says why."""


@dataclass(frozen=True)
class Unfinished:
    """A night under way: where it lies, what it becomes, and what it was begun as.

    ``lock``: a descriptor.
    """

    folder: Path
    final: Path
    plan: Plan
    lock: int

    @classmethod
    def begin(cls, final: Path, plan: Plan) -> Unfinished:
        """A new night that is to become the folder `final`. Raises OutputError."""
        require_free(final)
        folder = hidden(final)
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            raise OutputError(
                f"--out {final}: an unfinished night lies in {folder}; finish it with --resume, or remove it"
            ) from None
        except OSError as e:
            raise OutputError(f"--out {final}: {e.strerror or e}; nothing was written") from None
        try:
            (folder / UNITS).mkdir()
            night = cls(folder, final, plan, _locked(folder))
            write_whole(folder / PLAN, plan.model_dump_json(indent=2) + "\n")
        except BaseException as e:
            shutil.rmtree(folder, ignore_errors=True)
            if isinstance(e, OSError):
                raise OutputError(f"--out {final}: {e.strerror or e}; nothing was written") from None
            raise
        return night

    @classmethod
    def resume(cls, final: Path | None, history: Path) -> Unfinished:
        """The night that was to become `final`, or the newest one in `history` that nobody works at.

        Raises ResumeError.
        """
        found = [hidden(final)] if final else sorted(history.glob(f".*{SUFFIX}"), reverse=True)
        if not any(folder.is_dir() for folder in found):
            raise ResumeError(f"--resume: got no unfinished night {f'for {final}' if final else f'in {history}'}")
        for folder in found:
            try:
                plan = Plan.model_validate_json((folder / PLAN).read_bytes())
                lock = _locked(folder)
            except BlockingIOError:
                continue
            except FileNotFoundError:  # it ended before it had begun: it holds nothing
                if not final and folder != found[-1]:
                    continue
                raise ResumeError(f"--resume: {folder}: got no {PLAN}; remove the folder and start anew") from None
            except ValidationError as e:
                first = e.errors()[0]
                where = ".".join(map(str, first["loc"])) or "its text"
                what = f"{where}: got {str(first['input'])[:100]!r}: {first['msg']}"
                raise ResumeError(f"--resume: {folder / PLAN}: {what}; remove the folder and start anew") from None
            except OSError as e:
                raise ResumeError(
                    f"--resume: {folder / PLAN}: {e.strerror or e}; remove the folder and start anew"
                ) from None
            return cls(folder, final or folder.with_name(folder.name[1:].removesuffix(SUFFIX)), plan, lock)
        raise ResumeError(f"--resume: {found[0]}: another process is at work there")

    def unit(self, name: str) -> Path:
        """Folder of a unit."""
        return self.folder / UNITS / name

    def records(self) -> dict[str, Record]:
        """What was recorded of finished units, by name; what cannot be read is none."""
        found = {}
        for name in self.plan.units:
            with contextlib.suppress(OSError, ValidationError):
                found[name] = Record.model_validate_json((self.unit(name) / RECORD).read_bytes())
        return found

    def record(self, name: str, record: Record) -> None:
        """A unit has ended. Raises OSError."""
        write_whole(self.unit(name) / RECORD, record.model_dump_json(indent=2) + "\n")

    def publish(self, files: Mapping[str, str]) -> None:
        """Write the night's files and give it its name, in which nothing is ever changed. Raises OutputError."""
        for name, text in files.items():
            (self.folder / name).write_text(text, encoding="utf-8")
        _sync_all(self.folder)
        require_free(self.final)
        final = Path(os.path.realpath(self.final))
        with held(*INTERRUPTS):
            if os.path.ismount(final) or final == Path.cwd():  # these can not be replaced
                self._move(final)
            else:
                self.folder.rename(final)
                for name in (PLAN, LOCK):
                    (final / name).unlink()
            sync(final.parent)
        os.close(self.lock)

    def _move(self, final: Path) -> None:
        """Move everything into a folder, which may be another file system; last what makes it a night."""
        for path in self.folder.iterdir():
            if path.name not in (PLAN, LOCK, "run.json"):
                shutil.move(path, final / path.name)
        _sync_all(final)
        shutil.move(self.folder / "run.json", final / "run.json")
        _sync_all(final)
        shutil.rmtree(self.folder)


def _sync_all(folder: Path) -> None:
    for path in (*folder.rglob("*"), folder):
        sync(path)


def hidden(final: Path) -> Path:
    """Where a night lies until it is finished."""
    path = Path(os.path.realpath(final))
    return path.with_name(f".{path.name}{SUFFIX}")


def _locked(folder: Path) -> int:
    """A lock, as a descriptor, that ends with this process, however that ends.

    Raises BlockingIOError if another one has it.
    """
    descriptor = os.open(folder / LOCK, os.O_WRONLY | os.O_CREAT)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor
