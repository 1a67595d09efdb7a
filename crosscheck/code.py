"""Which code ran: a digest of its text, and the commit if it lies in a repository."""

from __future__ import annotations

import hashlib
import subprocess
from importlib import resources
from pathlib import Path

PARTS = ("analytic", "models", "crosscheck", "reports")


def code() -> dict[str, str]:
    """`sha256` of the text of every module and scene, `commit`, with `+` if something in it was changed since."""
    folders = [Path(str(resources.files(f"stewart_crosscheck.{part}"))) for part in PARTS]
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted(p for p in folder.rglob("*") if p.suffix in (".py", ".toml")):
            digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
    return {"sha256": digest.hexdigest(), "commit": _commit(folders[0].parent)}


def _commit(folder: Path) -> str:
    """Empty outside a repository, or without git."""

    def git(*arguments: str) -> str:
        command = ["git", "--no-optional-locks", "-C", str(folder), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()

    try:
        if Path(git("rev-parse", "--show-toplevel")).resolve() != folder.resolve():
            return ""  # somebody else's, around an environment
        return git("rev-parse", "HEAD") + ("+" if git("status", "--porcelain", "--", *PARTS) else "")
    except (OSError, subprocess.SubprocessError):
        return ""
