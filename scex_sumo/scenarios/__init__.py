"""Example seeds of our own making, and synthetic seeds populated by SUMO."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from scex_sumo.errors import UsageError

EXAMPLES = ("roundabout", "motorway_merge", "urban_intersection")


def example_path(name: str) -> Path:
    """The map of an example seed; its tracks lie beside it as ``NAME.csv``.

    Args:
        name: one of ``roundabout``, ``motorway_merge``, ``urban_intersection``.

    Raises:
        UsageError: there is no such example.
    """
    if name not in EXAMPLES:
        raise UsageError(f"unknown example seed {name!r}; known: {', '.join(EXAMPLES)}")
    return Path(str(resources.files(__name__).joinpath("data", f"{name}.osm")))
