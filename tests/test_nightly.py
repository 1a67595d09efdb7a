"""The command `nightly`, on the unit that takes the least time."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from stewart_crosscheck.crosscheck import cli
from stewart_crosscheck.reports import Night, load_night, night_files

AUDIT = ("--unit", "audit")


def nightly(
    *arguments: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> tuple[int, str, str]:
    monkeypatch.setattr(sys, "argv", ["crosscheck", "nightly", *arguments])
    with pytest.raises(SystemExit) as e:
        cli.main()
    out, err = capsys.readouterr()
    return int(e.value.code or 0), out, err


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: nightly(*arguments, monkeypatch=monkeypatch, capsys=capsys)


def rewritten(folder: Path, night: Night) -> None:
    """A baseline with other rows, sealed as it should be."""
    for name, text in night_files(night.checks, night.times, night.info, {}).items():
        (folder / name).write_text(text)


def test_the_accepted_baseline_is_what_this_code_gives(run, tmp_path: Path) -> None:
    status, out, err = run(*AUDIT)
    assert status == 0, out + err
    assert err.startswith("audit: 52 pass in ")
    assert out.splitlines()[-2].startswith("green: nothing worse; warnings 0; checks 52; against baseline (")
    (folder,) = (tmp_path / "runs").iterdir()
    assert out.splitlines()[-1] == f"results: {folder.relative_to(tmp_path)}"
    info = load_night(folder).info
    assert info["status"] == 0
    assert info["history"] == {"nights": [], "unreadable": []}


def test_a_baseline_is_made_accepted_and_compared_with(run, tmp_path: Path) -> None:
    base = ("--baseline", "base")
    status, out, err = run(*AUDIT, *base)
    assert (status, out) == (2, "")
    assert "base" in err
    assert not (tmp_path / "runs").exists(), "nothing was done before it was known"

    status, out, _ = run(*AUDIT, *base, "--update-baseline")
    assert status == 1, "nobody makes a baseline unseen"
    assert out.splitlines()[-1] == "new baseline: base"
    assert run(*AUDIT, *base)[0] == 0

    accepted = load_night(tmp_path / "base")
    lost = accepted.checks.iloc[[0]].assign(quantity="(99)")
    rewritten(tmp_path / "base", accepted._replace(checks=pd.concat([accepted.checks, lost])))
    status, out, _ = run(*AUDIT, *base, "--out", "red")
    assert status == 1
    assert "RED: gone 1; warnings 0; checks 52" in out
    for name in ("regressions.csv", "summary.md", "junit.xml"):
        assert "(99)" in (tmp_path / "red" / name).read_text(), name

    status, out, _ = run(*AUDIT, *base, "--update-baseline")
    assert status == 1
    assert "(99)" not in (tmp_path / "base" / "checks.csv").read_text()
    assert run(*AUDIT, *base)[0] == 0


def test_an_entry_of_the_history_that_was_damaged_is_named_and_left_out(run, tmp_path: Path) -> None:
    for name in ("1-nightly-a", "2-nightly-b"):
        assert run(*AUDIT, "--out", f"runs/{name}")[0] == 0
    checks = tmp_path / "runs" / "1-nightly-a" / "checks.csv"
    checks.write_bytes(checks.read_bytes()[:-100])
    before = checks.read_bytes()
    status, out, _ = run(*AUDIT, "--out", "runs/3-nightly-c")
    assert status == 0
    assert "Not read from the history" in out
    assert "1-nightly-a: checks.csv: " in out.replace("runs/", "")
    assert "1-nightly-a" in (tmp_path / "runs" / "3-nightly-c" / "summary.md").read_text()
    assert len(load_night(tmp_path / "runs" / "3-nightly-c").info["history"]["nights"]) == 1
    assert checks.read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--unit", "run-x"), "crosscheck: --unit: got an unknown unit 'run-x', expected one of run-collinear, "),
        (
            ("--resume", "--unit", "audit"),
            "crosscheck: Invalid value for '--resume': got it together with --unit, expected none: ",
        ),
        (
            ("--resume", "--baseline", "x"),
            "crosscheck: Invalid value for '--resume': got it together with --baseline, expected none: ",
        ),
        (("--resume",), "crosscheck: --resume: got no unfinished night in runs\n"),
        (("--baseline", "none"), "crosscheck: none: "),
        ((*AUDIT, "--out", "file"), "crosscheck: --out file: got a file, expected a folder "),
        ((*AUDIT, "--out", "/proc/night"), "crosscheck: --out /proc/night: "),
    ],
)
def test_unusable_input_is_one_line_and_nothing_is_written(
    arguments: tuple[str, ...], message: str, run, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    status, out, err = run(*arguments)
    assert (status, out) == (2, "")
    assert err.startswith(message)
    assert err.count("\n") == 1
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_terminal_shows_a_bar_and_keeps_the_lines(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "stewart_crosscheck.crosscheck", "nightly", *AUDIT]
    process = subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=theirs, env=os.environ | {"TERM": "xterm"}
    )
    os.close(theirs)
    shown = b""
    while True:
        try:
            shown += os.read(ours, 65536)
        except OSError:  # the other end is closed
            break
    os.close(ours)
    assert process.wait() == 0
    text = shown.decode()
    assert "0/1" in text
    assert "audit: 52 pass in " in text
