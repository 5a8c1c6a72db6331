"""Import of objects by path, ``package.module:name``, and registries of named extensions."""

from __future__ import annotations

import importlib
import importlib.metadata
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from importlib.abc import MetaPathFinder
from pathlib import Path
from typing import Any, Final

from scex_sumo.base.errors import MissingExtraError, UsageError

_PACKAGE = Path(__file__).resolve().parents[1]

of_others: Final = set[str]()
"""Modules that are not of this package and that `import_object` has imported."""


@dataclass(frozen=True, kw_only=True)
class Registry:
    """Extensions of one kind by name; each is imported when it is used.

    Packages register by an entry point, e.g. ``[project.entry-points."scex_sumo.exporters"]`` with ``name =
    "package.module:function"``.

    Attributes:
        group: the entry-point group, e.g. ``scex_sumo.exporters``.
        kind: the word for messages, e.g. ``export format``.
        last: name that comes after all others.
    """

    group: str
    kind: str
    last: str = ""

    @property
    def paths(self) -> dict[str, str]:
        """Import path by name; no other package takes a name of ours."""
        points = _of_group(importlib.metadata.entry_points, self.group, tuple(sys.path))
        named = sorted((p.name == self.last, p.name, not _of_package(p.value), p.value) for p in points)
        paths: dict[str, str] = {}
        for _, name, _, path in named:
            paths.setdefault(name, path)
        return paths

    def is_ours(self, name: str) -> bool:
        """Return whether a name belongs to this package."""
        return _of_package(self.paths.get(name, ""))

    def __contains__(self, name: object) -> bool:
        return ":" in str(name) or name in self.paths

    def load(self, name: str) -> Any:
        """Import the extension of a name, or of an import path ``package.module:object``."""
        paths = self.paths
        path = paths.get(name, name if ":" in name else None)
        if path is None:
            raise UsageError(f"unknown {self.kind} {name!r}; known: {', '.join(paths)}")
        return import_object(path)


@lru_cache(maxsize=64)
def _of_group(
    read: Callable[[], Any], group: str, path: tuple[str, ...]
) -> tuple[importlib.metadata.EntryPoint, ...]:
    """Return the entry points of a group on a path; a run asks a hundred times."""
    return tuple(_entry_points(read, path).select(group=group))


@lru_cache(maxsize=4)
def _entry_points(read: Callable[[], Any], _path: tuple[str, ...]) -> Any:
    """Return all entry points on a path; reading them takes milliseconds."""
    return read()


def _of_package(path: str) -> bool:
    return path.startswith(f"{_PACKAGE.name}.")


@contextmanager
def extra_for(need: str, extra: str) -> Iterator[None]:
    """Turn a failed import in the block into a `MissingExtraError`; ``need``: what needs which package."""
    try:
        yield
    except ImportError as error:
        raise MissingExtraError(
            f"{need} ({error}); install it: pip install '.[{extra}]' in the clone"
        ) from None


class _NoPandas(MetaPathFinder):
    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        if name == "pandas":
            raise ImportError(name)


def import_arrow() -> None:
    """Import Arrow and let it look for pandas now, and find none: loading it takes a quarter of a second.

    Others may still import pandas, and give its data to Arrow.
    """
    if "pandas" not in sys.modules:
        sys.meta_path.insert(0, finder := _NoPandas())
        try:
            import pyarrow as pa

            pa.array([1])
        finally:
            sys.meta_path.remove(finder)


def import_object(path: str, *, hint: str = "") -> Any:
    """Import an object by its path; modules in the current folder come after installed ones.

    Args:
        path: ``package.module:name``, or ``package.module`` for the module itself.
        hint: added to the message if there is no such module.

    Raises:
        UsageError: the import fails, or the name is missing.
    """
    name, _, attribute = path.partition(":")
    if not _of_package(path):
        of_others.add(name)
    here = str(Path.cwd())
    if here not in sys.path:
        # A console script has its own folder in the path instead.
        sys.path.append(here)
    try:
        module = importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is None or not (name == error.name or name.startswith(f"{error.name}.")):
            raise UsageError(f"{path}: {name} imports {error.name}, which is not installed") from None
        raise UsageError(
            f"{path}: no module {error.name} in {here} or among the installed packages{hint}"
        ) from None
    except (Exception, SystemExit) as error:
        from scex_sumo.base.blame import own_error_reason

        raise UsageError(f"{path}: importing {name} {own_error_reason(error)}") from error
    if not attribute:
        return module
    if not hasattr(module, attribute):
        names = [
            key
            for key, value in vars(module).items()
            if callable(value) and getattr(value, "__module__", None) == name and not key.startswith("_")
        ]
        there = f"; it has {', '.join(sorted(names))}" if names else ""
        raise UsageError(f"{path}: {name} ({module.__file__}) has no {attribute}{there}")
    return getattr(module, attribute)
