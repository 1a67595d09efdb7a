"""C source to a library that is loaded: compiled once for this machine, and kept.

The compiler is the one that ``CC`` names, else the package `ziglang` (the extra ``fast``), else ``cc``.
"""

from __future__ import annotations

import atexit
import ctypes
import functools
import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from platformdirs import user_cache_path

FLAGS = (
    "-std=c11",
    "-O3",
    "-march=native",
    "-fno-fast-math",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-ffp-contract=fast",
)
"""No option changes the value of an operation but for fused ones, which round once less."""


class NoCompiler(RuntimeError):
    """There is no C compiler, or it did not do its work: the message says what was tried and what helps."""


def compiler() -> list[str]:
    """Command of the C compiler. Raises NoCompiler."""
    asked = os.environ.get("CC", "").strip()
    if asked:
        try:
            return shlex.split(asked)
        except ValueError as e:
            raise NoCompiler(f"CC: got {asked!r}, expected a command: {e}") from None
    if importlib.util.find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc"]
    if shutil.which("cc"):
        return ["cc"]
    raise NoCompiler(
        "the back end `compiled` found no C compiler: expected one named by CC, the package ziglang"
        " (pip install stewart-crosscheck[fast]) or a command cc"
    )


def _processor() -> str:
    """What ``-march=native`` depends on."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    return "\n".join([platform.machine(), *(line for line in lines if line.startswith(("flags", "model name")))][:3])


def _kept_folder() -> Path:
    return user_cache_path("stewart-crosscheck")


@functools.cache
def _passing_folder(process: int) -> Path:
    """A folder that ends with this process, and not with one that it forked."""
    folder = Path(tempfile.mkdtemp(prefix="stewart-crosscheck-"))
    atexit.register(lambda: os.getpid() == process and shutil.rmtree(folder, ignore_errors=True))
    return folder


def library(source: str) -> ctypes.CDLL:
    """Compiled C source, from earlier times if there is one; kept for later if that is possible. Raises NoCompiler."""
    command = [*compiler(), *FLAGS, "-shared", "-fPIC"]
    key = hashlib.sha256("\0".join([source, *command, _processor()]).encode()).hexdigest()[:32]
    for folder in (_kept_folder, lambda: _passing_folder(os.getpid())):
        try:
            return _library(command, source, folder() / f"{key}.so")
        except OSError as e:  # it can not be written to, is full, or nothing in it can be run
            last = e
    raise NoCompiler(f"what the C compiler {shlex.join(command)} made can not be kept or loaded: {last}") from None


def _library(command: list[str], source: str, kept: Path) -> ctypes.CDLL:
    kept.parent.mkdir(parents=True, exist_ok=True)
    whole = kept.with_suffix(".sha256")  # what is damaged would end the process that loads it
    try:
        sound = hashlib.sha256(kept.read_bytes()).hexdigest() == whole.read_text()
    except OSError:
        sound = False
    if not sound:
        _compile(command, source, kept, whole)
    return ctypes.CDLL(str(kept))


def _compile(command: list[str], source: str, kept: Path, whole: Path) -> None:
    own = {name: str(kept.parent / "zig") for name in ("ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR")}
    with tempfile.TemporaryDirectory(dir=kept.parent) as name:  # renamed when whole: two at once do no harm
        text, made, digest = (Path(name, f"formulas{suffix}") for suffix in (".c", ".so", ".sha256"))
        text.write_text(source)
        command = [*command, "-o", str(made), str(text), "-lm"]
        try:
            done = subprocess.run(command, env={**own, **os.environ}, capture_output=True, text=True, check=False)
        except OSError as e:
            raise NoCompiler(f"the C compiler {command[0]} can not be run: {e.strerror or e}") from None
        if done.returncode:
            said = (done.stderr or done.stdout).strip().splitlines()
            raise NoCompiler(f"the C compiler {shlex.join(command)} failed: {said[-1] if said else done.returncode}")
        if not made.exists():
            raise NoCompiler(f"the C compiler {shlex.join(command)} made no library")
        digest.write_text(hashlib.sha256(made.read_bytes()).hexdigest())
        made.replace(kept)
        digest.replace(whole)
