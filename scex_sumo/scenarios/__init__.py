"""Seed scenes: examples, recorded moments, synthetic traffic."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from scex_sumo.base.errors import UsageError

if __name__ == "scenarios":
    raise ImportError("scenarios/ links to a package below scex_sumo: import scex_sumo.scenarios")

EXAMPLES = ("roundabout", "motorway_merge", "urban_intersection")


def example_path(name: str) -> Path:
    """Return the map of an example of ``EXAMPLES``; its tracks lie beside it as ``NAME.csv``.

    Raises:
        UsageError: there is no such example.

    Example:
        >>> scex.example_path("roundabout").name
        'roundabout.osm'
    """
    if name not in EXAMPLES:
        raise UsageError(f"unknown example seed {name!r}; known: {', '.join(EXAMPLES)}")
    return Path(str(resources.files(__name__).joinpath("data", f"{name}.osm")))
