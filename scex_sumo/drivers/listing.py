"""List of all behaviour models, as ``scex-sumo models`` prints it."""

from __future__ import annotations

from dataclasses import dataclass

from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.objects import parameter_texts
from scex_sumo.behaviors.spec import ModelEntry
from scex_sumo.drivers.registry import entry_of, known_names


@dataclass(frozen=True, kw_only=True)
class ModelInfo:
    """A model as ``scex-sumo models`` prints it; parameters are ``name=default``."""

    name: str
    parameters: tuple[str, ...]
    summary: str


def known_models() -> list[ModelInfo]:
    """Return all models."""
    return [
        ModelInfo(name=name, parameters=parameter_texts(entry.defaults), summary=entry.summary)
        for name, entry in known_entries().items()
    ]


def known_entries() -> dict[str, ModelEntry]:
    """Return the entries of all models; one that cannot be loaded says why in its summary."""
    entries = {}
    for name in known_names():
        try:
            entries[name] = entry_of(name)
        except UsageError as error:  # a broken package does not hide the other models
            summary = str(error).removeprefix(f"{name}: ")
            entries[name] = ModelEntry(make=dict, summary=summary, takes_guard=False)
    return dict(sorted(entries.items(), key=lambda item: item[1].place))
