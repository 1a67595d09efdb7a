"""What the commands share: the terminal, and arguments that mean the same everywhere."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

Scene = Annotated[str, typer.Argument(help="A built-in scene (see `crosscheck scenes`) or the path of a TOML file.")]
Out = Annotated[Path | None, typer.Option(help="Folder for the results. Default: runs/RUN_ID.")]


class _Console(Console):
    def on_broken_pipe(self) -> None:
        """Whoever read has gone (`| head`): be quiet from here on, the exit status stays that of the command."""
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.file.fileno())


def console(stderr: bool = False) -> Console:
    """Terminal output; a pipe gets lines of a width that tables fit."""
    console = _Console(stderr=stderr)
    return console if console.is_terminal else _Console(stderr=stderr, width=140)


def plain(to: Console, line: str) -> None:
    """A line as it is, of any length."""
    to.print(line, highlight=False, markup=False, soft_wrap=True)


def say(message: str) -> None:
    """A message on stderr."""
    with contextlib.suppress(OSError):  # stderr may be closed or full: the exit status still tells
        print(f"crosscheck: {message}", file=sys.stderr, flush=True)
