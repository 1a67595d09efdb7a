"""What the commands share: the terminal, and arguments that mean the same everywhere."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from ..models.reading import printable

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
    to.print(printable(line), highlight=False, markup=False, soft_wrap=True)


def say(message: str) -> None:
    """A message on stderr."""
    with contextlib.suppress(OSError):  # stderr may be closed or full: the exit status still tells
        lines = "\n".join(map(printable, message.split("\n")))
        print(f"crosscheck: {lines}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def steps(starting: str, to: Console) -> Iterator[Callable[[str, int], None]]:
    """A bar of long work, and what moves it on: called with a line for people and the number of all steps.

    Where nobody sees a bar, what a line says before its colon is printed, once.
    """
    columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=to, transient=True, disable=not to.is_terminal) as bar:
        said = set[str]()
        task = bar.add_task(starting, total=None)

        def done(line: str, total: int) -> None:
            bar.update(task, advance=1, total=total, description=line)
            stage = line.split(":")[0]
            if not to.is_terminal and stage not in said:
                plain(to, stage)
                said.add(stage)

        yield done


@contextlib.contextmanager
def one_by_one(total: int, to: Console) -> Iterator[tuple[Callable[[str], None], Callable[[str], None]]]:
    """A bar of things that are done one after another.

    Hands out what to call with the name of one that starts, and with a line for people when it has ended. The lines
    stay, on a terminal and in a log.
    """
    columns = BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}", markup=False)
    with Progress(*columns, console=to, transient=True, disable=not to.is_terminal) as bar:
        task = bar.add_task("", total=total)

        def done(line: str) -> None:
            plain(to, line)
            bar.update(task, advance=1, description="")

        yield lambda name: bar.update(task, description=name), done
