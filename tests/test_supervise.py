"""Commands within limits: how each end is told, and that nothing stays behind."""

from __future__ import annotations

import contextlib
import os
import secrets
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stewart_crosscheck.crosscheck import supervise as module
from stewart_crosscheck.crosscheck.supervise import CRASHED, ENDED, LATE, supervise

GIB = 2**30


def processes_with(mark: str) -> list[str]:
    """Processes that run and whose environment has it."""
    found = []
    for environ in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):
            if mark.encode() in environ.read_bytes():
                found.append(environ.parent.name)
    return found


@pytest.fixture
def mark(monkeypatch: pytest.MonkeyPatch) -> str:
    value = secrets.token_hex(16)
    monkeypatch.setenv("MARK_OF_A_TEST", value)
    return f"MARK_OF_A_TEST={value}"


def python(monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    """Run a script in place of `crosscheck`."""
    monkeypatch.setattr(module, "PROGRAM", (sys.executable, "-c", script))


def others(mark: str) -> list[str]:
    """Processes that the test has started, given a moment to be reaped."""
    deadline = time.monotonic() + 30
    while (found := [pid for pid in processes_with(mark) if int(pid) != os.getpid()]) and time.monotonic() < deadline:
        time.sleep(0.02)
    return found


@pytest.mark.parametrize("status", [0, 1, 3])
def test_an_exit_status_is_no_crash_and_what_was_printed_is_kept(
    status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    python(monkeypatch, f"import sys; print('out', flush=True); sys.stderr.write('err'); sys.exit({status})")
    outcome = supervise(["--out", "x"], tmp_path / "log", 60.0, 2 * GIB)
    assert (outcome.how, outcome.status, outcome.reason) == (ENDED, status, "")
    assert (tmp_path / "log").read_text() == "out\nerr"


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV, signal.SIGABRT])
def test_a_signal_is_a_crash(number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    python(monkeypatch, f"import os; os.kill(os.getpid(), {int(number)})")
    outcome = supervise([], tmp_path / "log", 60.0, 2 * GIB)
    assert outcome.how == CRASHED
    assert number.name in outcome.reason


def test_a_unit_hears_signals_and_leaves_no_core(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who starts it holds signals back for a moment, and what is held is inherited."""
    script = "import resource, signal; print(signal.pthread_sigmask(signal.SIG_BLOCK, ()), end=' ');"
    python(monkeypatch, f"{script} print(resource.getrlimit(resource.RLIMIT_CORE))")
    supervise([], tmp_path / "log", 60.0, 2 * GIB)
    assert (tmp_path / "log").read_text() == "set() (0, 0)\n"


CHILD = "import subprocess, sys, time; subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])"


def test_what_hangs_is_ended_with_all_that_it_has_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mark: str
) -> None:
    python(monkeypatch, f"{CHILD}; time.sleep(600)")
    outcome = supervise([], tmp_path / "log", 2.0, 2 * GIB)
    assert (outcome.how, outcome.reason) == (LATE, "no answer within 2 s")
    assert others(mark) == []


def test_what_it_leaves_behind_is_ended_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mark: str) -> None:
    python(monkeypatch, CHILD)
    assert supervise([], tmp_path / "log", 60.0, 2 * GIB).how == ENDED
    assert others(mark) == []


def test_a_process_that_eats_memory_is_stopped_by_its_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    python(monkeypatch, f"x = bytearray({GIB}); print('enough')")
    assert supervise([], tmp_path / "log", 60.0, GIB // 2).status == 1
    assert "MemoryError" in (tmp_path / "log").read_text()
    assert supervise([], tmp_path / "log", 60.0, 2 * GIB).status == 0
    assert (tmp_path / "log").read_text() == "enough\n"


def test_a_killed_parent_takes_its_command_along(tmp_path: Path, mark: str) -> None:
    script = (
        "import sys; from pathlib import Path; from stewart_crosscheck.crosscheck import supervise as module\n"
        "module.PROGRAM = (sys.executable, '-c', 'import time; print(1, flush=True); time.sleep(600)')\n"
        f"module.supervise([], Path({str(tmp_path / 'log')!r}), 600.0, 1 << 31)"
    )
    parent = subprocess.Popen([sys.executable, "-c", script])
    deadline = time.monotonic() + 60
    log = tmp_path / "log"
    while not (log.exists() and log.read_text()) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert len(processes_with(mark)) >= 2
    parent.kill()
    parent.wait()
    assert others(mark) == []
