"""Result files: whole or not at all, in a folder of their own."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from stewart_crosscheck.reports import (
    AGREEMENT_COLUMNS,
    MARGIN_COLUMNS,
    OutputError,
    files,
    require_free,
    write_files,
    write_run,
)

NAMES = {"agreement.csv", "margins.csv", "samples.csv", "run.json"}
SAMPLES_COLUMNS = ["engine", "route", "t", "leg", "quantity", "component", "value", "radius"]

AGREEMENT = pd.DataFrame(
    [dict.fromkeys(AGREEMENT_COLUMNS, "x") | {"max_abs": 0.1, "share": 0.25, "where": "leg 1", "reason": "none"}]
)
INFO = {"run_id": "a run", "status": 0}


def block(value: float, rows: int = 2) -> pd.DataFrame:
    return pd.DataFrame([["mujoco", "kkt", 0.1, 1, "F", "-", value, np.nan]] * rows, columns=SAMPLES_COLUMNS)


def write(folder: Path, value: float = 1.0) -> None:
    write_run(folder, AGREEMENT, [block(value)], INFO)


def names(folder: Path) -> set[str]:
    return {entry.name for entry in folder.iterdir()}


def value_in(folder: Path) -> float:
    """The one number that `write` was given, from a complete folder."""
    assert names(folder) >= NAMES
    return float(pd.read_csv(folder / "samples.csv")["value"].iloc[0])


# --- What is written --------------------------------------------------------------------------------------------------


def test_a_run_is_four_files_and_nothing_else(tmp_path: Path) -> None:
    write(tmp_path / "new" / "run")
    assert names(tmp_path) == {"new"}
    assert names(tmp_path / "new") == {"run"}
    assert names(tmp_path / "new" / "run") == NAMES
    assert json.loads((tmp_path / "new" / "run" / "run.json").read_text()) == INFO


def test_agreement_has_the_published_columns_only(tmp_path: Path) -> None:
    write(tmp_path / "run")
    assert list(pd.read_csv(tmp_path / "run" / "agreement.csv").columns) == AGREEMENT_COLUMNS


def test_margins_have_the_row_s_place_and_reason(tmp_path: Path) -> None:
    write(tmp_path / "run")
    (row,) = pd.read_csv(tmp_path / "run" / "margins.csv").to_dict("records")
    assert row == dict.fromkeys(("engine", "route", "quantity", "verdict"), "x") | {
        "margin": 0.25,
        "where": "leg 1",
        "reason": "none",
    }
    assert list(row) == MARGIN_COLUMNS


def test_blocks_of_samples_follow_one_header_with_17_digits(tmp_path: Path) -> None:
    write_run(tmp_path / "run", AGREEMENT, [block(1 / 3), block(2 / 3, rows=1)], INFO)
    assert (tmp_path / "run" / "samples.csv").read_text().splitlines() == [
        ",".join(SAMPLES_COLUMNS),
        "mujoco,kkt,0.10000000000000001,1,F,-,0.33333333333333331,",
        "mujoco,kkt,0.10000000000000001,1,F,-,0.33333333333333331,",
        "mujoco,kkt,0.10000000000000001,1,F,-,0.66666666666666663,",
    ]


def test_no_samples_leave_the_header(tmp_path: Path) -> None:
    write_run(tmp_path / "run", AGREEMENT, [], INFO)
    assert (tmp_path / "run" / "samples.csv").read_text() == ",".join(SAMPLES_COLUMNS) + "\n"


def test_others_may_read_the_folder(tmp_path: Path) -> None:
    write(tmp_path / "run")
    assert (tmp_path / "run").stat().st_mode & 0o777 == 0o755


# --- Whole or nothing -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("error", [RuntimeError, MemoryError, KeyboardInterrupt])
def test_an_error_among_the_samples_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    seen: list[set[str]] = []

    def samples() -> Iterator[pd.DataFrame]:
        yield block(1.0)
        seen.append({path.name for path in tmp_path.rglob("*") if path.is_file()})
        raise error("in the middle")

    with pytest.raises(error, match="in the middle"):
        write_run(tmp_path / "new" / "run", AGREEMENT, samples(), INFO)
    assert seen == [NAMES - {"run.json"}]  # it was at work when it failed
    assert names(tmp_path) == set()


def test_an_error_among_the_samples_leaves_an_empty_folder_empty(tmp_path: Path) -> None:
    def samples() -> Iterator[pd.DataFrame]:
        yield block(1.0)
        raise RuntimeError

    with pytest.raises(RuntimeError):
        write_run(tmp_path, AGREEMENT, samples(), INFO)
    assert names(tmp_path) == set()


@pytest.mark.parametrize("failing", [1, 2, 3, 4])
def test_a_full_disk_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: int) -> None:
    """The first, second, third or fourth table does not fit."""
    calls = [0]

    def until_full(write: Callable[..., object]) -> Callable[..., object]:
        def full(*args: object, **options: object) -> object:
            calls[0] += 1
            if calls[0] == failing:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return write(*args, **options)

        return full

    monkeypatch.setattr(pd.DataFrame, "to_csv", until_full(pd.DataFrame.to_csv))
    monkeypatch.setattr(files, "_write_rows", until_full(files._write_rows))
    folder = tmp_path / "new" / "run"
    with pytest.raises(OutputError, match=f"^--out {folder}: No space left on device; nothing was written$"):
        write_run(folder, AGREEMENT, [block(1.0), block(2.0)], INFO)
    assert names(tmp_path) == set()


@pytest.mark.parametrize("place", ["new/er/run", "empty"])
def test_everything_lies_on_the_disk_before_the_name_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    """A power cut leaves no folder with that name, or all of it: files, then their folder, the rename, who names it."""
    (tmp_path / "empty").mkdir()
    did: list[str] = []
    fsync, rename = os.fsync, os.rename

    def synced(descriptor: int) -> None:
        did.append(os.readlink(f"/proc/self/fd/{descriptor}"))
        fsync(descriptor)

    def renamed(source: Path, target: Path) -> None:
        did.append(f"rename to {target}")
        rename(source, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "rename", renamed)
    folder = tmp_path / place
    write(folder)
    first = next(i for i, what in enumerate(did) if what.startswith("rename"))
    last = max(i for i, what in enumerate(did) if what.startswith("rename"))
    *before, staging = did[:first]
    assert sorted(before) == sorted(f"{staging}/{name}" for name in NAMES)
    assert Path(staging).parent == (folder if place == "empty" else folder.parent)
    assert did[last + 1 :] == [str(folder)] if place == "empty" else [str(folder.parent), str(tmp_path)]


def test_a_disk_that_fails_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(descriptor: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fsync", broken)
    with pytest.raises(OutputError, match=r"Input/output error; nothing was written$"):
        write(tmp_path / "new" / "run")
    assert names(tmp_path) == set()


def test_a_file_that_outgrows_a_real_limit_leaves_nothing(tmp_path: Path) -> None:
    """The same with a limit of the system, at whatever byte it strikes, buffers of the file included."""
    script = (
        "import resource, sys; sys.path.insert(0, sys.argv[2]); from pathlib import Path; import test_files as t\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))\n"
        "try: t.write_run(Path(sys.argv[1]), t.AGREEMENT, [t.block(1.0, rows=1000)], t.INFO)\n"
        "except t.OutputError as e: print(e)\n"
    )
    folder = tmp_path / "new" / "run"
    command = [sys.executable, "-c", script, str(folder), str(Path(__file__).parent)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"--out {folder}: File too large; nothing was written\n"
    assert names(tmp_path) == set()


def test_model_files_are_written_whole_too(tmp_path: Path) -> None:
    write_files(tmp_path / "models", {"a.xml": "<a/>", "b.json": "{}"})
    assert (tmp_path / "models" / "a.xml").read_text() == "<a/>"
    assert names(tmp_path / "models") == {"a.xml", "b.json"}
    with pytest.raises(OutputError, match="nothing was written"):
        write_files(tmp_path / "other", {"a.xml": "<a/>", "no/such/folder": "{}"})
    assert names(tmp_path) == {"models"}


# --- Folders that exist -----------------------------------------------------------------------------------------------


def test_an_empty_folder_is_used_as_it_is(tmp_path: Path) -> None:
    """The same folder, not another one of its name: it may be a mount or somebody's current folder."""
    folder = tmp_path / "run"
    folder.mkdir(mode=0o700)
    before = folder.stat()
    write(folder)
    assert names(folder) == NAMES
    assert names(tmp_path) == {"run"}
    assert (folder.stat().st_ino, folder.stat().st_mode) == (before.st_ino, before.st_mode)


def test_the_current_folder_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path("."))
    assert names(tmp_path) == NAMES


def test_a_link_to_an_empty_folder_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "link").symlink_to("run")
    write(tmp_path / "link")
    assert names(tmp_path / "run") == NAMES
    assert (tmp_path / "link").is_symlink()


def test_two_runs_into_one_new_folder_lose_nothing(tmp_path: Path) -> None:
    """One run writes while another does: the second to end keeps its results beside, and says where."""
    folder = tmp_path / "run"

    def samples() -> Iterator[pd.DataFrame]:
        write(folder, value=1.0)
        yield block(2.0)

    with pytest.raises(
        OutputError, match=f"^--out {folder}: another run filled it meanwhile; .* of this one are in "
    ) as e:
        write_run(folder, AGREEMENT, samples(), INFO)
    kept = Path(str(e.value).rpartition(" are in ")[2])
    assert names(tmp_path) == {"run", kept.name}
    assert not kept.name.startswith(".")
    assert value_in(folder) == 1.0
    assert value_in(kept) == 2.0


def test_two_runs_into_one_empty_folder_lose_nothing(tmp_path: Path) -> None:
    def samples() -> Iterator[pd.DataFrame]:
        write(tmp_path, value=1.0)
        yield block(2.0)

    with pytest.raises(OutputError, match="another run filled it meanwhile") as e:
        write_run(tmp_path, AGREEMENT, samples(), INFO)
    kept = Path(str(e.value).rpartition(" are in ")[2])
    assert names(tmp_path) == set(NAMES)  # the first run's folder holds the first run alone
    assert value_in(tmp_path) == 1.0
    assert value_in(kept) == 2.0


def test_a_run_that_ends_after_another_loses_nothing(tmp_path: Path) -> None:
    """Both found the folder free; the first had ended before the second began to write."""
    require_free(tmp_path / "run")
    write(tmp_path / "run", value=1.0)
    with pytest.raises(OutputError, match="another run filled it meanwhile") as e:
        write(tmp_path / "run", value=2.0)
    assert value_in(tmp_path / "run") == 1.0
    assert value_in(Path(str(e.value).rpartition(" are in ")[2])) == 2.0


# --- Folders that cannot be used --------------------------------------------------------------------------------------


@pytest.fixture
def crowded(tmp_path: Path) -> Path:
    """A folder with a file, a filled folder, an empty one and links."""
    (tmp_path / "file").write_text("text")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "entry").write_text("text")
    (tmp_path / "empty").mkdir()
    (tmp_path / "dangling").symlink_to("nowhere")
    (tmp_path / "loop").symlink_to("loop")
    return tmp_path


@pytest.mark.parametrize(
    ("name", "got"),
    [
        ("file", "got a file"),
        ("dangling", "got a file"),
        ("loop", "got a file"),
        ("full", "got a folder that is not empty"),
        ("file/below", "Not a directory"),
        ("file/far/below", "Not a directory"),
        ("x" * 300, "File name too long"),
    ],
    ids=["file", "dangling link", "link to itself", "full", "below a file", "far below a file", "long name"],
)
def test_a_folder_that_cannot_be_used_is_named_and_nothing_is_touched(crowded: Path, name: str, got: str) -> None:
    before = sorted(crowded.rglob("*"))
    with pytest.raises(OutputError) as e:
        require_free(crowded / name)
    assert str(e.value).startswith(f"--out {crowded / name}: {got}, expected ")
    with pytest.raises(OutputError, match="expected"):
        write_files(crowded / name, {"a.xml": "<a/>"})
    assert sorted(crowded.rglob("*")) == before


def test_a_place_that_only_refuses_when_tried_is_named() -> None:
    """Root may do anything by the permissions of /proc, and yet not make a folder there."""
    with pytest.raises(OutputError, match=r"^--out /proc/results: .*, expected a folder that can be written to$"):
        require_free(Path("/proc/results"))


@pytest.mark.parametrize("name", ["empty", "new", "new/er", "."])
def test_a_free_folder_is_left_as_it_was(crowded: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(crowded / "empty")
    before = sorted(crowded.rglob("*"))
    require_free(Path(".") if name == "." else crowded / name)
    assert sorted(crowded.rglob("*")) == before
