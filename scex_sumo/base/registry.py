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

    Packages register by an entry point, e.g. ``[project.entry-points."scex_sumo.exporters"]`` with ``name =
    "package.module:function"``.

    Attributes:
        group: the entry-point group, e.g. ``scex_sumo.exporters``.
        kind: the word for messages, e.g. ``export format``.
        builtin: import path by name, of the core's own.
    """

    group: str
    kind: str
    builtin: Mapping[str, str] = field(default_factory=dict)

    @property
    def paths(self) -> dict[str, str]:
        """Import path by name: the built-in ones first, which win over entry points."""
        points = sorted((p.name, p.value) for p in importlib.metadata.entry_points(group=self.group))
        return {**self.builtin, **{name: path for name, path in points if name not in self.builtin}}

    def __contains__(self, name: object) -> bool:
        return name in self.builtin or ":" in str(name) or name in self.paths

    def load(self, name: str) -> Any:
        """Import the extension of a name, or of an import path ``package.module:object``."""
        if name in self.builtin:  # looking for entry points takes milliseconds
            return import_object(self.builtin[name])
        paths = self.paths
        path = paths.get(name, name if ":" in name else None)
        if path is None:
            raise UsageError(f"unknown {self.kind} {name!r}; known: {', '.join(paths)}")
        return import_object(path)
