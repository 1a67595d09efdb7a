"""The workflows: what makes a night of theirs one that can be trusted, and that each of it would be missed."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import pytest

from stewart_crosscheck.crosscheck.engine import engine_names, load_engine
from stewart_crosscheck.crosscheck.ranges import DISTRIBUTION

ROOT = Path(__file__).parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
NIGHTLY = (ROOT / ".github" / "workflows" / "nightly.yml").read_text()

HIDING = {
    "continue-on-error": r"continue-on-error",
    "a command whose failure is ignored": r"\|\|\s*(true|:|exit 0)|set \+e",
}


class Step(NamedTuple):
    """A step of a job, as text."""

    text: str

    def has(self, pattern: str) -> bool:
        return re.search(pattern, self.text, re.MULTILINE) is not None

    @property
    def always(self) -> bool:
        return self.has(r"^ +if: \$\{\{ always\(\) \}\}$")


def steps(workflow: str) -> list[Step]:
    """Steps of the one job, which are the items of the list `steps`."""
    return [Step(text) for text in re.split(r"^      - ", workflow.split("    steps:\n")[1], flags=re.MULTILINE)[1:]]


def hidden(workflow: str) -> list[str]:
    """Ways in which a failure would not be seen."""
    return [what for what, pattern in HIDING.items() if re.search(pattern, workflow)]


def wrong(workflow: str) -> list[str]:
    """What the workflow of a night lacks."""
    found = steps(workflow)
    nights = [step for step in found if step.has(r"crosscheck nightly")]
    if len(nights) != 1:
        return ["one night"]
    before, after = found[: found.index(nights[0])], found[found.index(nights[0]) + 1 :]
    job_limit, step_limit = (
        int(limit[1]) if (limit := re.search(rf"^{indent}timeout-minutes: (\d+)", workflow, re.MULTILINE)) else 0
        for indent in ("    ", "        ")
    )
    uploads = [step for step in after if step.has(r"uses: actions/upload-artifact@")]
    needed = {
        "a schedule": re.search(r'^  schedule:\n    - cron: "\d+ \d+ \* \* \*"$', workflow, re.MULTILINE),
        "both sets of engines": re.search(r"^ +engines: \[pinned, newest\]$", workflow, re.MULTILINE),
        "the other set, if one is red": re.search(r"^ +fail-fast: false", workflow, re.MULTILINE),
        "make newest": any(step.has(r"^ +if: matrix.engines == 'newest'\n +run: make newest$") for step in before),
        "the night without a condition": not nights[0].has(r"^ +if:"),
        "a limit of the night below that of the job": 0 < step_limit < job_limit,
        "earlier nights": any(step.has(r"uses: actions/cache/restore@") for step in before),
        "a history of its own for each set": workflow.count("nights-${{ matrix.engines }}-") == 3,
        "a summary": any(step.has(r"summary\.md\" >> \"\$GITHUB_STEP_SUMMARY\"") for step in after),
        "one upload": len(uploads) == 1,
        "an upload of what is there": uploads and uploads[0].has(r"^ +runs/\$\{\{ env.NIGHT \}\}$"),
        "an upload of what was interrupted": uploads
        and uploads[0].has(r"^ +runs/\.\$\{\{ env.NIGHT \}\}\.unfinished$")
        and uploads[0].has(r"^ +include-hidden-files: true$"),
        "a failure without anything to upload": uploads and uploads[0].has(r"^ +if-no-files-found: error$"),
        "a history that is kept": any(step.has(r"uses: actions/cache/save@") for step in after),
        "the rest after a failure": all(step.always for step in after),
    }
    return [what for what, there in needed.items() if not there]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_no_workflow_hides_a_failure(path: Path) -> None:
    assert hidden(path.read_text()) == []


@pytest.mark.parametrize("line", ["continue-on-error: true", "run: make test || true", "run: make x||exit 0", "set +e"])
def test_a_hidden_failure_is_seen(line: str) -> None:
    assert len(hidden(f"{NIGHTLY}\n        {line}\n")) == 1


def test_the_night_has_what_it_needs() -> None:
    assert wrong(NIGHTLY) == []


@pytest.mark.parametrize(
    ("old", "new", "lacks"),
    [
        ('cron: "17 2 * * *"', 'cron: "17 2 1 1 *"', "a schedule"),
        ("[pinned, newest]", "[pinned]", "both sets of engines"),
        ("fail-fast: false", "fail-fast: true", "the other set, if one is red"),
        ("run: make newest", "run: make setup", "make newest"),
        ("if: matrix.engines == 'newest'", "if: matrix.engines == 'pinned'", "make newest"),
        (
            "- name: The night\n",
            "- name: The night\n        if: matrix.engines == 'pinned'\n",
            "the night without a condition",
        ),
        ("crosscheck nightly", "crosscheck run", "one night"),
        ("        timeout-minutes: 30", "        timeout-minutes: 45", "a limit of the night below that of the job"),
        ("cache/restore@", "cache/save@", "earlier nights"),
        ("restore-keys: nights-${{ matrix.engines }}-", "restore-keys: nights-", "a history of its own for each set"),
        ('/summary.md" >> "$GITHUB_STEP_SUMMARY"', '/summary.md"', "a summary"),
        ("actions/upload-artifact@", "actions/cache@", "one upload"),
        ("            runs/${{ env.NIGHT }}\n", "", "an upload of what is there"),
        ("            runs/.${{ env.NIGHT }}.unfinished\n", "", "an upload of what was interrupted"),
        ("include-hidden-files: true", "include-hidden-files: false", "an upload of what was interrupted"),
        ("if-no-files-found: error", "if-no-files-found: warn", "a failure without anything to upload"),
        ("cache/save@", "cache/restore@", "a history that is kept"),
        ("if: ${{ always() }}", "if: ${{ success() }}", "the rest after a failure"),
    ],
)
def test_what_it_needs_would_be_missed(old: str, new: str, lacks: str) -> None:
    assert old in NIGHTLY
    assert lacks in wrong(NIGHTLY.replace(old, new, 1))


def test_the_newest_engines_are_every_engine_package() -> None:
    recipe = (ROOT / "Makefile").read_text().split("\nnewest: setup\n")[1].split("\n\n")[0]
    assert "--upgrade" in recipe
    packages = {load_engine(name).package for name in engine_names()} - {DISTRIBUTION}
    assert len(packages) == 4
    assert packages <= set(recipe.split())
