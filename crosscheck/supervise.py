"""One command in a process of its own, within limits of time and memory; nothing of it stays when it has ended."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

from . import limited
from .processes import death

PROGRAM = (sys.executable, "-m", "stewart_crosscheck.crosscheck")

MEMORY = min(8 * 2**30, os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2)
"""Bytes that one process of a unit may take: forty times what the largest needs, and never all that there is."""

CRASHED, LATE, ENDED = "crashed", "late", "ended"


class Outcome(NamedTuple):
    """How a command ended: by itself with an exit status, by a signal, or because its time was up."""

    how: str
    status: int
    seconds: float
    reason: str


def supervise(arguments: Sequence[str], log: Path, seconds: float, memory: int) -> Outcome:
    """Run `crosscheck` with arguments in a session of its own; what it prints goes to ``log``.

    It is killed, with every process that it has started, after ``seconds``, when this process dies, and when this is
    interrupted.  ``memory``: bytes of data that each of its processes may have.
    """
    temporary = log.with_suffix(".tmp")  # what a killed process leaves there goes with it
    temporary.mkdir()
    limits = (sys.executable, "-I", "-S", limited.__file__, str(memory), str(os.getpid()))
    start = perf_counter()
    with contextlib.ExitStack() as ended, open(log, "wb") as file:
        ended.callback(shutil.rmtree, temporary, ignore_errors=True)
        with limited.held(*limited.INTERRUPTS):  # until there is something to end
            process = subprocess.Popen(
                [*limits, *PROGRAM, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env=os.environ | {"TMPDIR": str(temporary)},
            )
            ended.callback(_end, process)
        try:
            status = process.wait(seconds)
            how, reason = (ENDED, "") if status >= 0 else (CRASHED, death(status, str(log)))
        except subprocess.TimeoutExpired:
            how, status, reason = LATE, 0, f"no answer within {seconds:.0f} s"
    return Outcome(how, status, perf_counter() - start, reason)


def _end(process: subprocess.Popen) -> None:
    """Kill what is left of a session."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
