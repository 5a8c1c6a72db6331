"""Suite on disk: ``suite.json``, its cases, maps, and what is checked when it is opened."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import ResultError, one_line
from scex_sumo.base.files import sha256_of
from scex_sumo.converters.maps import read_map
from scex_sumo.results.tables.states import read_scene
from scex_sumo.road import Road
from scex_sumo.scene import SeedScene
from scex_sumo.suites.estimate import Design
from scex_sumo.suites.rules_json import rules_of_json

SUITE: Final = "suite.json"
CASE: Final = "case.json"
FORMAT: Final = "scex-sumo suite 4"
"""Name and version of the format."""
CASES: Final = "cases"
MAPS: Final = "maps"


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One case of a suite.

    Attributes:
        folder: of its files.
        about: its entry of ``suite.json``.
    """

    folder: Path
    about: Mapping[str, Any]

    @property
    def name(self) -> str:
        """Name of the case, and of its folder."""
        return str(self.about["name"])

    @cached_property
    def content(self) -> Mapping[str, Any]:
        """Content of ``case.json``, checked against the digests of the suite."""
        for name, digest in self.about["files"].items():
            file = self.folder / name
            if not file.is_file() or sha256_of(file) != digest:
                what = "was changed" if file.is_file() else "is missing"
                raise ResultError(f"{file}: {what} since the suite was made; make the suite again")
        content: Mapping[str, Any] = _json(self.folder / CASE)
        return content

    def scene(self) -> SeedScene:
        """Return the seed scene with its road, rules and lights."""
        about = self.content["seed_scene"]
        origin = about["origin"]
        road = _road((self.folder / about["map"]).resolve(), tuple(origin) if origin else None)
        rules = about.get("rules") and rules_of_json(
            _json(self.folder / about["rules"]), self.content["lights"]
        )
        scene = read_scene(self.folder, about)
        return replace(scene, road=road, rules=rules, time_s=about["time_s"], location=about["location"])


@lru_cache(maxsize=4)
def _road(path: Path, origin: tuple[float, float] | None) -> Road:
    road = read_map(path, origin=origin, own_corner=False)
    return replace(road, net=None, origin=origin or road.origin)


@dataclass(frozen=True, kw_only=True, eq=False)
class Suite:
    """A weighted test suite.

    Attributes:
        info: content of ``suite.json``.

    Example:
        >>> [name for name in scex.Suite.__dataclass_fields__]
        ['folder', 'info']
    """

    folder: Path
    info: Mapping[str, Any]

    @cached_property
    def cases(self) -> Sequence[Case]:
        """The cases, by kind and P of people."""
        return [Case(folder=self.folder / CASES / one["name"], about=one) for one in self.info["cases"]]

    @property
    def design(self) -> Design:
        """How the cases were drawn."""
        cases = self.info["cases"]
        weight, chance = (np.array([one[name] for one in cases], np.float64) for name in ("weight", "chance"))
        stratum = np.array([one["stratum"] for one in cases], np.int64)
        return Design(weight=weight, chance=chance, stratum=stratum, hours=float(self.info["hours"]))


@checked
def open_suite(folder: str | Path) -> Suite:
    """Open a suite that ``scex-sumo catalogue`` wrote.

    Raises:
        ResultError: there is none, it has no case, or it is of another version.

    Example:
        >>> scex.catalogue(scex.example_path("roundabout"), out="s", count=2, every=9, formats=()).folder.name
        's'
        >>> len(scex.open_suite("s").cases)
        2
    """
    folder = Path(folder)
    file = folder / SUITE
    if not file.is_file():
        raise ResultError(f"{folder}: no suite ({SUITE} is missing); make one with 'scex-sumo catalogue'")
    info = _json(file)
    if info.get("format") != FORMAT:
        raise ResultError(
            f"{file}: format {info.get('format')!r}, this version reads {FORMAT!r}; make the suite again"
        )
    lacks = [name for name in ("cases", "hours", "seed", "futures", "people") if name not in info]
    if lacks:
        raise ResultError(f"{file}: has no {lacks[0]!r}; make the suite again")
    if not info["cases"]:
        raise ResultError(f"{file}: the suite has no case; make it again")
    return Suite(folder=folder, info=info)


def _json(file: Path) -> dict[str, Any]:
    try:
        content = json.loads(file.read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise ResultError(f"{file}: cannot be read ({one_line(error)[:120]}); make the suite again") from None
    if not isinstance(content, dict):
        raise ResultError(f"{file}: holds no object; make the suite again")
    return content
