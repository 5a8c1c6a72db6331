"""Registry of named extensions: a mapping of names to import paths, extended by an entry-point group."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from scex_sumo.base.errors import UsageError
from scex_sumo.base.importing import import_object


@dataclass(frozen=True, kw_only=True)
class Registry:
    """Extensions of one kind by name; each is imported when it is used.

    The wings of this package and the packages of other people register in the same way, by an entry point:
    ``[project.entry-points."scex_sumo.exporters"]`` with ``name = "package.module:function"``.

    Attributes:
        group: the entry-point group, e.g. ``scex_sumo.exporters``.
        kind: what one of them is called in messages, e.g. ``export format``.
        builtin: import path by name, of those that the core has itself.
    """

    group: str
    kind: str
    builtin: Mapping[str, str] = field(default_factory=dict)

    @property
    def paths(self) -> dict[str, str]:
        """Import path by name: the built-in ones first, then those of entry points by name.

        A built-in name wins over an entry point of the same name.
        """
        points = sorted((p.name, p.value) for p in importlib.metadata.entry_points(group=self.group))
        return {**self.builtin, **{name: path for name, path in points if name not in self.builtin}}

    def __contains__(self, name: object) -> bool:
        """Return whether `load` can look up a name: it is registered, or an import path."""
        return name in self.builtin or ":" in str(name) or name in self.paths

    def load(self, name: str) -> Any:
        """Import the extension of a name, or of an import path ``package.module:object``.

        An import path without ``:object`` names a module.

        Raises:
            UsageError: the name is unknown, or the import fails.
        """
        if name in self.builtin:  # to look for entry points takes milliseconds
            return import_object(self.builtin[name])
        paths = self.paths
        path = paths.get(name, name if ":" in name else None)
        if path is None:
            raise UsageError(f"unknown {self.kind} {name!r}; known: {', '.join(paths)}")
        return import_object(path)
