"""Suite on disk: ``suite.json``, its cases, maps and rules, and what is checked when it is opened."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from scex_sumo.base.arguments import checked
from scex_sumo.base.errors import ResultError
from scex_sumo.base.files import refuse_special_files, sha256_of
from scex_sumo.base.schema import read_json
from scex_sumo.converters.maps import read_map
from scex_sumo.results.tables.states import read_scene
from scex_sumo.road import Road
from scex_sumo.road_rules import Passage, Rules, Signal
from scex_sumo.scene import SeedScene
from scex_sumo.suites.estimate import Design

SUITE: Final = "suite.json"
CASE: Final = "case.json"
FORMAT: Final = "scex-sumo suite 5"
"""Name and version of the format."""
CASES: Final = "cases"
MAPS: Final = "maps"
AGAIN: Final = "make the suite again"
_SUITE, _CASE, RULES = (
    json.loads(Path(__file__).with_name(f"{name}.schema.json").read_bytes())
    for name in ("suite", "case", "rules")
)
LIGHTS: Final = _CASE["properties"]["lights"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One case of a suite: the folder of its files, and its entry of ``suite.json``."""

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
                problem = "was changed" if file.is_file() else "is missing"
                raise ResultError(f"{file}: {problem} since the suite was made; {AGAIN}")
        content: Mapping[str, Any] = read_json(self.folder / CASE, _CASE, AGAIN)
        return content

    def _named(self, name: str) -> Path:
        """Return a file that ``case.json`` names, if the digests of the suite hold for it."""
        if name not in self.about["files"]:
            raise ResultError(f"{self.folder / CASE}: names {name[:80]}, which the suite has not; {AGAIN}")
        return (self.folder / name).resolve()

    def scene(self) -> SeedScene:
        """Return the seed scene with its road, rules and lights."""
        about, lights = self.content["seed_scene"], self.content["lights"]
        origin, rules = about["origin"], about.get("rules")
        road = _road(self._named(about["map"]), tuple(origin) if origin else None)
        try:
            rules = rules and rules_of_json(read_json(self._named(rules), RULES, AGAIN), lights)
        except ValueError as error:
            raise ResultError(f"{self.folder / CASE}: {error}; {AGAIN}") from None
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
        return [Case(folder=self.folder / CASES / case["name"], about=case) for case in self.info["cases"]]

    @property
    def design(self) -> Design:
        """How the cases were drawn."""
        cases = self.info["cases"]
        names = ("weight", "chance", "stratum")
        weight, chance, stratum = (np.array([case[name] for case in cases]) for name in names)
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
    refuse_special_files(folder)
    info = read_json(file, _SUITE, AGAIN)
    if len({case["name"] for case in info["cases"]}) < len(info["cases"]):
        raise ResultError(f"{file}: a case has the name of another one; {AGAIN}")
    return Suite(folder=folder, info=info)


def rules_to_json(rules: Rules) -> dict[str, Any]:
    """Return rules without their lights."""
    return {
        "passages": [_plain(passage) for passage in rules.passages],
        "stop_lines": [line.tolist() for line in rules.stop_lines],
        "crosswalks": [outline.tolist() for outline in rules.crosswalks],
    }


def lights_to_json(rules: Rules) -> list[dict[str, Any]]:
    """Return the lights of rules; one without letters is unknown."""
    return [_plain(light) for light in rules.signals]


def _plain(rule: Passage | Signal) -> dict[str, Any]:
    return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in vars(rule).items()}


def rules_of_json(content: Mapping[str, Any], lights: Sequence[Mapping[str, Any]]) -> Rules:
    """Return the rules of `rules_to_json`, of the schema `RULES`, with lights of `LIGHTS`.

    Raises:
        ValueError: they do not fit each other.
    """
    passages = content["passages"]
    others = max((k for passage in passages for k in passage["yields_to"]), default=-1)
    if others >= len(passages) or max((passage["signal"] for passage in passages), default=-1) >= len(lights):
        raise ValueError("a passage names a passage or a light that is not there")
    for light in lights:
        ends = [0.0, *light["ends_s"]]
        if ends != sorted({*ends}) or len(light["letters"]) != len(light["ends_s"]):
            raise ValueError("a light has not one end for each phase, one after the other")
    return Rules(
        passages=tuple(
            Passage(
                line=np.array(passage["line"]),
                lanes=tuple(passage["lanes"]),
                state=passage["state"],
                signal=passage["signal"],
                yields_to=tuple(passage["yields_to"]),
            )
            for passage in passages
        ),
        signals=tuple(
            Signal(letters=light["letters"], ends_s=np.array(light["ends_s"]), start_s=light["start_s"])
            for light in lights
        ),
        stop_lines=tuple(map(np.array, content["stop_lines"])),
        crosswalks=tuple(map(np.array, content["crosswalks"])),
    )
