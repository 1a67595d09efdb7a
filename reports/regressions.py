"""What became worse from one night to another: since when, and what to suspect first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from math import inf, isnan, log
from typing import TYPE_CHECKING, Any

from .checks import CHECK_KEY
from .findings import FAILS, FINDING_COLUMNS, NEW, NOT_RUN, SEVERITIES, Finding, Row, judge
from .history import Night, processor
from .slower import compare_times

if TYPE_CHECKING:
    import pandas as pd

Key = tuple[str, ...]

SMALLEST = 5e-324
"""Stands for a ratio of zero, which has no logarithm."""


def compare(before: Night, after: Night, past: Sequence[Night] = ()) -> pd.DataFrame:
    """Findings of `after` against `before`, the gravest first; what did not change has none.

    Parameters
    ----------
    before, after
        From `load_night` or `night_of`. Units that `after` did not run are missed if it was to be a whole night.
    past
        Nights earlier than `after`, newest first: they tell since when, and are further repetitions of times.
    """
    import pandas as pd

    old, new = _rows(before), _rows(after)
    whole = after.info.get("whole", False)
    keys = [*new, *(key for key in old if key not in new and (whole or key[0] in after.info["units"]))]
    told = [(key, finding) for key in keys for finding in judge(old.get(key), new.get(key))]
    worse = {key for key, finding in told if finding.severity != "info"}
    nights = [(night, _rows(night, worse)) for night in past]
    suspects = _Suspects(before, after)
    findings = suspects.notes()
    for key, finding in told:
        was, now = old.get(key), new.get(key)
        if finding.severity != "info":
            finding = finding._replace(since=_since(finding, key, was, nights))
        findings.append(finding._replace(suspect=suspects.of(finding, was, now)))
    findings += [f._replace(suspect=suspects.of(f)) for f in compare_times(before, after, past)]
    return pd.DataFrame(sorted(findings, key=_order), columns=FINDING_COLUMNS)


def counts(findings: pd.DataFrame) -> dict[tuple[str, str], int]:
    """Findings by severity and what they are, in their order."""
    return dict(Counter(zip(findings["severity"], findings["what"], strict=True)))


def status(findings: pd.DataFrame) -> int:
    """Exit status: 1 a disagreement or a regression, 3 something did not run, 0 neither; a warning is none."""
    failed = set(findings.loc[findings["severity"] == "fail", "what"])
    return 1 if failed - {NOT_RUN} else 3 if failed else 0


def _order(finding: Finding) -> tuple:
    """By severity, then the largest ratio first, or the smallest of what is better; without a ratio last."""
    size = -inf if isnan(finding.ratio) else log(max(finding.ratio, SMALLEST))
    if finding.severity == "info" and size > -inf:
        size = abs(size)
    return SEVERITIES.index(finding.severity), -size, finding.what, finding[2:8]


def _rows(night: Night, wanted: Iterable[Key] | None = None) -> dict[Key, Row]:
    keys = list(zip(*(night.checks[name] for name in CHECK_KEY), strict=True))
    chosen = range(len(keys)) if wanted is None else [i for i, key in enumerate(keys) if key in wanted]
    rows = night.checks.iloc[list(chosen)].to_dict("records")
    return {keys[i]: {str(name): value for name, value in row.items()} for i, row in zip(chosen, rows, strict=True)}


def _since(finding: Finding, key: Key, before: Row | None, nights: Sequence[tuple[Night, Mapping[Key, Row]]]) -> str:
    """The oldest night of the unbroken chain in which it was as bad; those that did not run it are passed over."""
    since = NEW
    for night, rows in nights:
        if key[0] not in night.info["units"]:
            continue
        told = judge(before, rows.get(key))
        if finding.what != NOT_RUN and any(then.what == NOT_RUN for then in told):
            continue
        if not any(_as_bad(then, finding) for then in told):
            break
        since = night.name
    return since


def _as_bad(then: Finding, now: Finding) -> bool:
    """Whether it was red then, or the same was told and it was not less than half as far off."""
    if then.what == FAILS and now.what != NOT_RUN:
        return now.what not in ("tolerance wider", "floor wider", "new")
    graver = SEVERITIES.index(then.severity) <= SEVERITIES.index(now.severity)
    return then.what == now.what and graver and not then.ratio < now.ratio / 2.0


class _Suspects:
    """What changed between two nights, as suspects of what became worse."""

    def __init__(self, before: Night, after: Night) -> None:
        old, new = before.info, after.info
        names = [*new["versions"], *(name for name in old["versions"] if name not in new["versions"])]
        pairs = {name: (old["versions"].get(name), new["versions"].get(name)) for name in names}
        self.versions = {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}
        self.engines = _engine_versions(before), _engine_versions(after)
        self.code = _code(old["code"], new["code"])
        self.machine = "" if processor(old) == processor(new) else f"{processor(old)} → {processor(new)}"

    def of(self, finding: Finding, before: Row | None = None, after: Row | None = None) -> str:
        """The first suspect of what is worse: the row's own engine, packages of no engine, the code, the machine."""
        if finding.severity == "info" or finding.what == "new":
            return ""
        engine = finding.engine
        own = self._own(engine, before, after)
        if own[0] != own[1] and (all(own) or (own[0] or None, own[1] or None) in self.versions.values()):
            return f"{engine} {_change(own)}"  # a crashed unit has no version of its engine: that is no change
        names = {name for versions in self.engines for name in versions if name != engine}
        others = {self._own(name) for name in names}
        shared = [f"{n} {_change(p)}" for n, p in self.versions.items() if (p[0] or "", p[1] or "") not in others]
        return "; ".join(shared[:3]) or self.code or self.machine or "nothing changed: not reproducible?"

    def _own(self, engine: str, before: Row | None = None, after: Row | None = None) -> tuple[str, str]:
        old, new = (
            (row["engine_version"] if row else "") or versions.get(engine, "")
            for row, versions in zip((before, after), self.engines, strict=True)
        )
        return old, new

    def notes(self) -> list[Finding]:
        """A row for each version that changed, and for the code."""
        notes = [("version changed", name, _change(pair)) for name, pair in self.versions.items()]
        notes += [("code changed", "code", self.code.removeprefix("code "))] if self.code else []
        return [Finding("info", what, "", "", "", "", "", name, reason=change) for what, name, change in notes]


def _engine_versions(night: Night) -> dict[str, str]:
    known = night.checks[night.checks["engine_version"] != ""]
    return dict(zip(known["engine"], known["engine_version"], strict=True))


def _change(pair: Sequence[str | None]) -> str:
    return " → ".join(version or "not installed" for version in pair)


def _code(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """What to call a change of the code: by its commits, or by its digests where those tell nothing."""
    if old.get("sha256") == new.get("sha256"):
        return ""
    names = [_commit(facts.get("commit", "")) for facts in (old, new)]
    if not all(names) or names[0] == names[1]:
        names = [str(facts.get("sha256"))[:9] for facts in (old, new)]
    return f"code {' → '.join(names)}"


def _commit(commit: str) -> str:
    """Short; with a `+` if something was changed since."""
    return commit[:9] + "+" * commit.endswith("+")
