"""Limits of a process, and a program that puts them on itself and then becomes another one.

Run by its path, with nothing but Python's own library: `limited.py MEMORY PARENT COMMAND...`.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
import signal
import sys
from collections.abc import Iterator

PR_SET_PDEATHSIG = 1
_prctl = ctypes.CDLL(None).prctl


def end_with(parent: int) -> None:
    """Have the system kill this process when its parent ends, however that ends and whatever is going on here."""
    _prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if parent != os.getppid():  # it ended before
        os.kill(os.getpid(), signal.SIGKILL)


INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def held(*signals: signal.Signals) -> Iterator[None]:
    """Signals come when this has ended; processes and threads that start meanwhile do not hear them at all."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


if __name__ == "__main__":
    memory, parent, *command = sys.argv[1:]
    end_with(int(parent))
    signal.pthread_sigmask(signal.SIG_SETMASK, ())  # who started it held signals back for itself
    resource.setrlimit(resource.RLIMIT_DATA, (int(memory), int(memory)))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.execv(command[0], command)
