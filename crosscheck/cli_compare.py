"""The command `compare`."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from ..reports import (
    HistoryError,
    earlier,
    junit,
    load_night,
    print_regressions,
    require_free,
    status,
    summary,
    write_files,
)
from ..reports import compare as compare_nights
from .run import new_run_id, provenance
from .terminal import Out, console, plain


def compare(
    run_a: Annotated[Path, typer.Argument(metavar="RUN_A", help="Folder of a night, or of the accepted baseline.")],
    run_b: Annotated[Path, typer.Argument(metavar="RUN_B", help="Folder of a later night.")],
    out: Out = None,
) -> int:
    """Tell what became worse, or better, from RUN_A to RUN_B.

    Nights beside RUN_B tell since when. Writes regressions.csv, junit.xml, summary.md and run.json. Exit status:
    0 nothing is red, 1 a disagreement or a regression, 2 unusable input, 3 something did not run in RUN_B, 4 an
    internal error.
    """
    require_free(out or Path("runs", "RUN_ID"))
    before, after = load_night(run_a), load_night(run_b)
    if before.info["run_id"] == after.info["run_id"]:
        raise HistoryError(
            f"{run_b}: run.json: run_id: got {after.info['run_id']}, that of {run_a}, expected another: a run compared"
            " with itself proves nothing"
        )
    past, unreadable = earlier(run_b.absolute().parent, after.info["started"])
    findings = compare_nights(before, after, past)
    started = datetime.now(UTC)
    run_id = new_run_id("compare", started)
    info = provenance(run_id, started, None, {}) | {
        "before": before.info["run_id"],
        "after": after.info["run_id"],
        "status": status(findings),
    }
    folder = out or Path("runs") / run_id
    write_files(
        folder,
        {
            "regressions.csv": findings.to_csv(index=False, float_format="%.6g"),
            "junit.xml": junit(after, findings),
            "summary.md": summary(before, after, findings, unreadable),
            "run.json": json.dumps(info, indent=2) + "\n",
        },
    )
    screen = console()
    print_regressions(before, after, findings, screen, unreadable)
    plain(screen, f"results: {folder}")
    return status(findings)
