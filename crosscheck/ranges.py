"""Versions of engines: which this project is made for, and that a library is what its package says it is."""

from __future__ import annotations

from importlib.metadata import requires
from typing import Any

from packaging.requirements import Requirement
from packaging.version import Version

from .engine import Engine, EngineError, engine_version

DISTRIBUTION = "stewart-crosscheck"


def out_of_range(engine: type[Engine]) -> str:
    """Say of an installed version that it is none of those that this project is made for; empty if it is one."""
    found = engine_version(engine)
    for text in requires(DISTRIBUTION) or ():
        wanted = Requirement(text)
        if wanted.name == engine.package and found and not wanted.specifier.contains(found, prereleases=True):
            return f"{engine.package} {found} is installed, expected {wanted.specifier}"
    return ""


def require_version(engine: type[Engine], library: Any) -> Any:
    """Give the library that was imported, if its version is that of the package, which is what reports name.

    Raises EngineError if it is another one: a library may come in several packages, and one may be left behind.
    """
    told = engine_version(engine)
    if told and Version(library.__version__).base_version != Version(told).base_version:
        raise EngineError(
            f"{engine.name}: the library that was imported is of version {library.__version__}, expected {told} as its"
            f" package {engine.package} says: install all of its packages anew"
        )
    return library
