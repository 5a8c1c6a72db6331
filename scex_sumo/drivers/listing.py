"""List of all behaviour models, as ``scex-sumo models`` prints it."""

from __future__ import annotations

import inspect
import re
from typing import Final, NamedTuple

from scex_sumo.base.errors import UsageError
from scex_sumo.behaviors.objects import parameter_texts
from scex_sumo.behaviors.spec import GUARD, ModelEntry
from scex_sumo.drivers.registry import entry_of, known_names
from scex_sumo.plug_in.inputs import Surroundings

_SHARED: Final = {
    "path": "index from left to right (-1: the rightmost), straight or random",
    "file": "file of the function",
    GUARD: "brake for everybody within the path's corridor and at crossings",
}
"""Meanings of parameters that several models have."""

_DOCUMENTED: Final = re.compile(r"^    (\w+): (.*(?:\n {5,}\S.*)*)", re.MULTILINE)  # of Args and Attributes


class ModelInfo(NamedTuple):
    """A model as ``scex-sumo models`` prints it."""

    name: str
    parameters: tuple[str, ...]  # ``name=default``, those that people set first
    summary: str
    meanings: dict[str, str]  # of parameters, where their class documents them


def known_models() -> list[ModelInfo]:
    """Return all models."""
    return [_info(name, entry) for name, entry in known_entries().items()]


def model_info(name: str) -> ModelInfo:
    """Return one model; a `UsageError` for an unknown name."""
    return _info(name, entry_of(name))


def _info(name: str, entry: ModelEntry) -> ModelInfo:
    """Parameters mean what the docstrings of the profile say, else of what makes the model."""
    makers = (entry.make,) if entry.profile is None else type(entry.profile).__mro__
    meanings = dict(_SHARED)
    for documented in (Surroundings, *reversed(makers)):
        for key, text in _DOCUMENTED.findall(inspect.getdoc(documented) or ""):
            meanings[key] = " ".join(text.replace("``", "").replace("`", "").split()).removesuffix(".")
    return ModelInfo(name, parameter_texts(entry.defaults), entry.summary, meanings)


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
