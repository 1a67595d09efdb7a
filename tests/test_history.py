"""The history: nights are read as they were written, or it is said what is wrong with them."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from math import inf, isnan, nan
from pathlib import Path

import duckdb
import pandas as pd
import pytest
from nights import FIRST, VERSIONS, check, files, night, times, write

from stewart_crosscheck.reports import HistoryError, OutputError, earlier, load_night, night_of, write_baseline
from stewart_crosscheck.reports import baseline as baseline_module
from stewart_crosscheck.reports.checks import CHECK_COLUMNS, RANK, TIME_COLUMNS
from stewart_crosscheck.reports.history import MOST, printable

AFTER_ALL = "2030-01-01T00:00:00+00:00"


def two_nights(history: Path) -> tuple[Path, Path]:
    return write(history, 0, check(), times=times(1.0, 1.1, 0.9)), write(history, 1, check())


# --- What is written is what is read ------------------------------------------------------------------------------


def test_a_night_is_read_as_it_was_written(tmp_path: Path) -> None:
    rows = [
        check(quantity="NA", reason="nan", where="None", route="null", setting="007"),
        check(quantity="", error=nan, tolerance=nan, floor=nan, margin=nan, verdict="refused"),
        check(quantity="M_s", error=inf, margin=inf, verdict="silent"),
    ]
    folder = write(tmp_path, 0, *rows, times=times(1.0, 1.25), more={"summary.md": "# A night\n"})
    read = load_night(folder)
    assert read.folder == folder
    assert list(read.checks.columns) == CHECK_COLUMNS
    assert list(read.times.columns) == TIME_COLUMNS
    first, second, third = read.checks.to_dict("records")
    assert [first[name] for name in ("quantity", "reason", "where", "route", "setting")] == [
        "NA", "nan", "None", "null", "007",
    ]  # fmt: skip
    assert first["error"] == 1e-12
    assert second["quantity"] == second["reason"] == ""
    assert all(isnan(second[name]) for name in ("error", "tolerance", "floor", "margin"))
    assert third["error"] == third["margin"] == inf
    assert read.times["ratio"].tolist() == [1.0, 1.25]
    assert read.times["batch"].tolist() == ["1", "1"]  # part of a key: a text in both nights
    assert set(read.info["files"]) == {"checks.csv", "times.csv", "summary.md", "run.json"}
    digest = hashlib.sha256((folder / "checks.csv").read_bytes()).hexdigest()
    assert read.info["files"]["checks.csv"] == digest
    assert read.name == "20261101T030000Z-nightly-0000"
    assert read._replace(folder=tmp_path / "other").name == "other (20261101T030000Z-nightly-0000)"


def test_missing_texts_are_empty_and_whatever_breaks_a_line_is_escaped(tmp_path: Path) -> None:
    hostile = 'a|b,"c"\r\n\x00\x1b[31m\u2028\ud800 é → <b>\uffff'
    folder = write(tmp_path, 0, check(reason=hostile), check(quantity="F_r", reason=None, where=nan))
    first, second = load_night(folder).checks.to_dict("records")
    assert first["reason"] == 'a|b,"c"\\r\\n\\x00\\x1b[31m\\u2028\\ud800 é → <b>\\uffff' == printable(hostile)
    assert second["reason"] == second["where"] == ""
    assert len((folder / "checks.csv").read_text().splitlines()) == 3


def test_a_table_that_cannot_be_read_back_is_not_written() -> None:
    with pytest.raises(HistoryError, match=r"run-hexapod hexapod mujoco kkt F twice, expected one row of each"):
        files(0, [check(), check(error=2e-12)])
    with pytest.raises(HistoryError, match=r"verdict of .*: got 'great', expected one of pass, accurate"):
        files(0, [check(verdict="great")])
    with pytest.raises(HistoryError, match=r"error of .*: got '-1e-12', expected a number that is not negative"):
        files(0, [check(error=-1e-12)])
    with pytest.raises(HistoryError, match=r"bench-1 twice"):
        files(0, [], [*times(1.0), *times(2.0)])
    with pytest.raises(HistoryError, match=r"no column 'ratio', expected run_id, unit, task"):
        baseline_module.night_files(
            pd.DataFrame(columns=CHECK_COLUMNS), pd.DataFrame(columns=TIME_COLUMNS[:-1]), {"run_id": "x"}, {}
        )


# --- What is not as it was written is found and named -------------------------------------------------------------


def edit(name: str, change: Callable[[str], str]) -> Callable[[Path], object]:
    return lambda folder: (folder / name).write_text(change((folder / name).read_text()))


def resealed(change: Callable[[dict], object]) -> Callable[[Path], None]:
    """Facts that someone changed who knows of the digests."""

    def spoil(folder: Path) -> None:
        info = json.loads((folder / "run.json").read_text())
        change(info)
        files = {name: digest for name, digest in info["files"].items() if name != "run.json"}
        info["files"] = files
        sealed = hashlib.sha256(json.dumps(info, sort_keys=True).encode()).hexdigest()
        info["files"] = {**files, "run.json": sealed}
        (folder / "run.json").write_text(json.dumps(info))

    return spoil


def table(name: str, change: Callable[[str], str]) -> Callable[[Path], None]:
    """A table that someone changed who knows of the digests."""

    def spoil(folder: Path) -> None:
        (folder / name).write_text(change((folder / name).read_text()))
        digest = hashlib.sha256((folder / name).read_bytes()).hexdigest()
        resealed(lambda info: info["files"].update({name: digest}))(folder)

    return spoil


def replace_by_folder(folder: Path) -> None:
    (folder / "checks.csv").unlink()
    (folder / "checks.csv").mkdir()


def replace_by_pipe(folder: Path) -> None:
    (folder / "run.json").unlink()
    os.mkfifo(folder / "run.json")


def loop(folder: Path) -> None:
    (folder / "times.csv").unlink()
    (folder / "times.csv").symlink_to(folder / "times.csv")


CORRUPTIONS: dict[str, tuple[Callable[[Path], object], str]] = {
    "truncated": (edit("checks.csv", lambda t: t[: len(t) // 2]), "checks.csv: got .* bytes that differ"),
    "one digit": (edit("checks.csv", lambda t: t.replace("1e-12", "2e-12")), "checks.csv: got .* bytes that differ"),
    "empty": (edit("times.csv", lambda t: ""), "times.csv: got 0 bytes that differ"),
    "missing": (lambda f: (f / "checks.csv").unlink(), "checks.csv: No such file or directory, expected a file"),
    "no run.json": (lambda f: (f / "run.json").unlink(), "run.json: No such file"),
    "a folder": (replace_by_folder, "checks.csv: got something else, expected a file"),
    "a pipe": (replace_by_pipe, "run.json: got something else, expected a file"),
    "a loop of links": (loop, "times.csv: (Too many levels|No such file)"),
    "no JSON": (edit("run.json", lambda t: t[:-20]), r"run.json: got no JSON \("),
    "deep JSON": (edit("run.json", lambda t: "[" * 100_000), r"run.json: got no JSON \("),
    "no text": (lambda f: (f / "run.json").write_bytes(b"\xff\xfe\x80"), r"run.json: got no JSON \("),
    "a list": (edit("run.json", lambda t: "[1, 2]"), "run.json: got list, expected an object"),
    "another command": (resealed(lambda i: i.pop("kind")), "run.json: kind: got None, expected 'nightly'"),
    "no versions": (resealed(lambda i: i.pop("versions")), "run.json: versions: got None, expected what a night"),
    "a version edited": (edit("run.json", lambda t: t.replace("2.4.0", "2.4.1")), "run.json: got other facts than"),
    "no date": (
        resealed(lambda i: i.update(started="yesterday")),
        "run.json: started: got 'yesterday', expected a",
    ),
    "no zone": (resealed(lambda i: i.update(started="2026-11-01T03:00:00")), "started: got '2026-11-01T03:00:00'"),
    "a way out": (resealed(lambda i: i["files"].update({"../x": "0"})), "files: got '../x', expected names of files"),
    "columns": (
        table("checks.csv", lambda t: t.replace("quantity", "amount", 1)),
        "checks.csv: got columns run_id",
    ),
    "a short row": (table("checks.csv", lambda t: t + "a,b\n"), "checks.csv: row 3: got 2 fields, expected 16"),
    "a quote": (table("checks.csv", lambda t: t + '"a'), r"checks.csv: got no table \(unexpected end of data\)"),
    "nothing": (table("times.csv", lambda t: ""), "times.csv: got no table"),
    "twice": (table("checks.csv", lambda t: t + t.splitlines()[1] + "\n"), "checks.csv: got run-hexapod .* twice"),
    "no verdict": (
        table("checks.csv", lambda t: t.replace(",pass,", ",passed,")),
        "got 'passed', expected one of",
    ),
    "no number": (table("checks.csv", lambda t: t.replace("1e-12", "tiny")), "error of .*: got 'tiny', expected a num"),
    "NaN": (table("checks.csv", lambda t: t.replace("1e-12", "nan")), "error of .*: got 'nan', expected a number"),
}


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_a_corrupted_night_is_named_and_left_out(tmp_path: Path, name: str) -> None:
    good, bad = two_nights(tmp_path)
    spoil, message = CORRUPTIONS[name]
    spoil(bad)
    with pytest.raises(HistoryError, match=message) as e:
        load_night(bad)
    assert str(e.value).startswith(f"{bad}: ")
    nights, unreadable = earlier(tmp_path, AFTER_ALL)
    assert [n.folder for n in nights] == [good]
    assert unreadable == [str(e.value)]
    with pytest.raises(HistoryError, match=message):
        load_night(bad)  # reading changes nothing


def test_a_file_or_a_loop_in_place_of_a_night_is_named(tmp_path: Path) -> None:
    good, bad = two_nights(tmp_path)
    loop = tmp_path / "20261105T030000Z-nightly-0005"
    loop.symlink_to(loop)
    file = tmp_path / "20261106T030000Z-nightly-0006"
    file.write_text("a night?")
    nights, unreadable = earlier(tmp_path, AFTER_ALL)
    assert [n.folder for n in nights] == [bad, good]
    assert [message.split(": ")[0] for message in unreadable] == [str(loop), str(file)]


def test_a_night_that_must_not_be_read_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    good, bad = two_nights(tmp_path)
    real = Path.read_bytes

    def refused(path: Path) -> bytes:
        if path.parent == bad:
            raise PermissionError(13, "Permission denied")
        return real(path)

    monkeypatch.setattr(Path, "read_bytes", refused)  # root may read everything
    nights, unreadable = earlier(tmp_path, AFTER_ALL)
    assert [n.folder for n in nights] == [good]
    assert unreadable == [f"{bad}: run.json: Permission denied, expected a file of a finished night"]


# --- Which nights are earlier -------------------------------------------------------------------------------------


def test_earlier_nights_come_newest_first_by_when_they_started(tmp_path: Path) -> None:
    folders = {day: write(tmp_path, day, check()) for day in (2, 0, 3, 1)}
    folders[1].rename(tmp_path / "zzz")  # --out gives any name
    nights, unreadable = earlier(tmp_path, load_night(folders[3]).info["started"])
    assert [n.info["run_id"][:8] for n in nights] == ["20261103", "20261102", "20261101"]
    assert not unreadable


def test_what_is_no_night_is_passed_over(tmp_path: Path) -> None:
    good, _ = two_nights(tmp_path)
    (tmp_path / "20261104T030000Z-hexapod-0001").mkdir()
    (tmp_path / "20261104T030000Z-hexapod-0001" / "run.json").write_text('{"run_id": "a run"}')
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "empty").mkdir()
    good.rename(tmp_path / ".unfinished-nightly-1")
    nights, unreadable = earlier(tmp_path, AFTER_ALL)
    assert len(nights) == 1
    assert not unreadable
    assert earlier(tmp_path / "notes.txt", AFTER_ALL)[1] == [
        f"{tmp_path / 'notes.txt'}: Not a directory, expected a folder of nights"
    ]


def test_a_copied_night_counts_once(tmp_path: Path) -> None:
    good, _ = two_nights(tmp_path)
    subprocess.run(["cp", "-r", good, tmp_path / "copy"], check=True)
    nights, unreadable = earlier(tmp_path, AFTER_ALL)
    assert len(nights) == 2
    assert "run_id: got that of " in unreadable[0]


def test_at_most_so_many_nights_are_read(tmp_path: Path) -> None:
    for day in range(MOST + 2):
        write(tmp_path, day, check())
    nights, _ = earlier(tmp_path, AFTER_ALL)
    assert len(nights) == MOST
    assert nights[0].info["started"] > nights[-1].info["started"] > FIRST.isoformat()


# --- The accepted baseline ----------------------------------------------------------------------------------------


def test_a_first_baseline_is_written_short(tmp_path: Path) -> None:
    made = night(0, check(error=1.23456e-12), times=times(1.23456, 1.0, 0.9), command=["/somewhere"], seconds=3.0)
    write_baseline(tmp_path / "new" / "baseline", made)
    read = load_night(tmp_path / "new" / "baseline")
    assert {entry.name for entry in read.folder.iterdir()} == {"checks.csv", "times.csv", "run.json"}
    assert read.checks["error"].tolist() == [1.23e-12]
    assert read.times["ratio"].tolist() == [1.23, 1.0, 0.9]
    assert set(read.info) == {"kind", "run_id", "started", "versions", "code", "machine", "units", "files"}
    assert read.info["units"] == ["bench-1", "bench-2", "bench-3", "run-hexapod"]


@pytest.mark.parametrize("verdict", RANK)
def test_a_baseline_holds_nothing_red(tmp_path: Path, verdict: str) -> None:
    made = night(0, check(), check(quantity="M_s", verdict=verdict))
    if verdict in ("fail", "error"):
        with pytest.raises(HistoryError, match=r"1 red rows, the first run-hexapod hexapod mujoco kkt M_s; expected"):
            write_baseline(tmp_path / "baseline", made)
        assert not (tmp_path / "baseline").exists()
    else:
        write_baseline(tmp_path / "baseline", made)
        assert len(load_night(tmp_path / "baseline").checks) == 2


def test_units_that_a_whole_night_has_no_more_leave_the_baseline(tmp_path: Path) -> None:
    write_baseline(tmp_path, night(0, check(), check(unit="audit")))
    write_baseline(tmp_path, night(1, check(), whole=True))
    found = load_night(tmp_path)
    assert found.checks["unit"].tolist() == found.info["units"] == ["run-hexapod"]
    assert found.checks["run_id"].tolist() == ["20261101T030000Z-nightly-0000"], "the row came out as before"


def test_rows_of_units_that_were_not_run_stay_and_unchanged_rows_keep_their_line(tmp_path: Path) -> None:
    first = night(0, check(), check(quantity="gone"), check(unit="audit"), times=times(1.0, 1.1, 0.9))
    write_baseline(tmp_path, first)
    before = (tmp_path / "checks.csv").read_text().splitlines()
    second = night(1, check(error=1.0004e-12), check(quantity="new"), versions=VERSIONS | {"numpy": "2.5.0"})
    write_baseline(tmp_path, second)
    after = (tmp_path / "checks.csv").read_text().splitlines()
    assert [line.split(",")[1] + line.split(",")[7] for line in set(before) - set(after)] == ["run-hexapodgone"]
    assert [line.split(",")[1] + line.split(",")[7] for line in set(after) - set(before)] == ["run-hexapodnew"]
    read = load_night(tmp_path)
    assert read.times["ratio"].tolist() == [1.0, 1.1, 0.9]
    assert read.info["versions"]["numpy"] == "2.5.0"
    assert set(read.info["units"]) == {"run-hexapod", "audit", "bench-1", "bench-2", "bench-3"}
    write_baseline(tmp_path, night(2, check(error=1.01e-12), check(quantity="new")))
    changed = set((tmp_path / "checks.csv").read_text().splitlines()) - set(after)
    assert [line.split(",")[0][:8] for line in changed] == ["20261103"]


def test_times_of_two_processors_are_not_mixed(tmp_path: Path) -> None:
    write_baseline(tmp_path, night(0, check(), times=times(1.0, 1.1, 0.9)))
    other = {"processor": "x86_64", "model": "Another processor", "usable_cores": 2}
    with pytest.raises(HistoryError, match="machine: got x86_64, Another processor, 2 cores, expected x86_64, A proc"):
        write_baseline(tmp_path, night(1, check(), machine=other))
    write_baseline(tmp_path, night(1, check(), times=times(2.0, 2.1, 1.9), machine=other))
    assert load_night(tmp_path).info["machine"] == other


def test_a_failed_update_leaves_the_baseline_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_baseline(tmp_path, night(0, check()))
    before = {entry.name: entry.read_bytes() for entry in tmp_path.iterdir()}

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left on device, expected a folder that can be written to"):
        write_baseline(tmp_path, night(1, check(error=5e-12)))
    assert {entry.name: entry.read_bytes() for entry in tmp_path.iterdir()} == before


def test_a_baseline_in_a_full_or_read_only_place_is_refused_clearly(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"/proc/.*, expected a folder that can be written to"):
        write_baseline(Path("/proc/baseline"), night(0, check()))
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="expected a folder that can be written to"):
        write_baseline(tmp_path / "file", night(0, check()))


def test_a_corrupted_baseline_is_not_built_upon(tmp_path: Path) -> None:
    write_baseline(tmp_path, night(0, check()))
    CORRUPTIONS["one digit"][0](tmp_path)
    with pytest.raises(HistoryError, match=r"checks.csv: got .* bytes that differ"):
        write_baseline(tmp_path, night(1, check()))


def test_an_update_killed_in_between_is_found_out(tmp_path: Path) -> None:
    """After the first of three files: what is left is neither the old nor the new one, and it says so."""
    write_baseline(tmp_path, night(0, check()))
    program = (
        "import os, sys; sys.path.insert(0, 'tests'); from nights import *; from stewart_crosscheck.reports import *\n"
        "from pathlib import Path; real, left = os.replace, [1]\n"
        "def replace(a, b):\n    left[0] -= 1\n    os.kill(os.getpid(), 9) if left[0] < 0 else real(a, b)\n"
        "os.replace = replace; write_baseline(Path(sys.argv[1]), night(1, check(error=5e-12)))"
    )
    done = subprocess.run([sys.executable, "-c", program, tmp_path], cwd=Path(__file__).parent.parent)
    assert done.returncode == -9
    with pytest.raises(HistoryError, match=r"checks.csv: got .* bytes that differ"):
        load_night(tmp_path)


# --- Readable by others -------------------------------------------------------------------------------------------


def test_the_history_is_one_line_in_duckdb_and_pandas(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for day in range(3):
        rows = [check(reason="a|b, c"), check(quantity="M_s", error=nan, verdict="error", reason="killed")]
        write(tmp_path / "runs", day, *rows, times=times(1.0 + day, 1.1, 0.9))
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parent.parent / "docs" / "nightly.md").read_text()
    red, median, versions = re.search(r"```sql\n(.*?)\n```", page, re.S)[1].splitlines()  # pyright: ignore[reportOptionalSubscript]
    assert len(duckdb.sql(red).fetchall()) == 3
    assert [row[1] for row in duckdb.sql(median).fetchall()] == [1.0, 1.1, 1.1]
    assert [row[2] for row in duckdb.sql(versions).fetchall()] == ["4.0.0"] * 3
    line = 'checks = pd.concat(map(pd.read_csv, Path("runs").glob("*-nightly-*/checks.csv")))'
    assert line in page
    checks = pd.concat(map(pd.read_csv, Path("runs").glob("*-nightly-*/checks.csv")))
    assert checks.groupby("quantity")["error"].median()["F"] == 1e-12
    assert len(checks) == 6


def test_texts_of_a_night_are_a_night() -> None:
    texts = files(0, [check()])
    assert night_of(Path("here"), texts).checks["error"].tolist() == [1e-12]
    with pytest.raises(HistoryError, match=r"^here: checks.csv: got"):
        night_of(Path("here"), texts | {"checks.csv": texts["checks.csv"].replace("1e-12", "1e-11")})
