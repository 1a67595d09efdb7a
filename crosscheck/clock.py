"""Where an adapter's time goes: the calls of the engine's library, by name; what is left of the wall time is ours."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from time import perf_counter
from types import ModuleType
from typing import Any, ClassVar, Protocol

import numpy as np


class Watched(Protocol):
    """An engine that says how it holds its library.

    ``handles``: attributes through which it is called, modules or objects, alone or in lists.  ``objects``: first part
    of the module names of objects whose methods are calls too, None if all calls are functions of a module.
    """

    handles: ClassVar[tuple[str, ...]]
    objects: ClassVar[str | None]


@contextmanager
def watching(engine: Watched) -> Iterator[Mapping[str, float]]:
    """Seconds in each call of an engine's library, {name: seconds}, of what runs inside.

    Reading the clock takes time as well, outside of these: compare their sum with the wall time of the same work when
    it is not watched.
    """
    spent: dict[str, float] = defaultdict(float)
    kept = {name: getattr(engine, name) for name in engine.handles}
    try:
        for name, value in kept.items():
            setattr(engine, name, _stand_in(value, spent, engine.objects))
        yield spent
    finally:
        for name, value in kept.items():
            setattr(engine, name, value)


def _stand_in(value: Any, spent: dict[str, float], objects: str | None) -> Any:
    """The same value, with its calls timed if it is of the library."""
    if isinstance(value, list | tuple):
        return type(value)(_stand_in(x, spent, objects) for x in value)
    of_library = objects is not None and type(value).__module__.split(".")[0] == objects
    return _Timed(value, spent, objects) if of_library or isinstance(value, ModuleType) else value


class _Timed:
    """In the place of a module, class, object or function of the library."""

    def __init__(self, value: Any, spent: dict[str, float], objects: str | None) -> None:
        self.__dict__.update(_value=value, _spent=spent, _objects=objects)

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._value, name)
        is_class = isinstance(value, type)
        if isinstance(value, ModuleType) or (is_class and self._objects):
            value = _Timed(value, self._spent, self._objects)
        elif callable(value) and not is_class:
            value = self._timed(name, value)
        else:
            return value  # data may change
        self.__dict__[name] = value
        return value

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self._value, name, value)

    def __call__(self, *args: Any) -> Any:
        return self._timed(self._value.__name__, self._value)(*args)

    def _timed(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        spent, objects = self._spent, self._objects

        def timed(*args: Any) -> Any:
            raw = [x._value if type(x) is _Timed else x for x in args]
            start = perf_counter()
            try:
                result = call(*raw)
            finally:
                spent[name] += perf_counter() - start
            return result if objects is None or type(result) is np.ndarray else _stand_in(result, spent, objects)

        return timed
