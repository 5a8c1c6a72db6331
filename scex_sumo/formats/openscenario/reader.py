"""OpenSCENARIO scenarios (ASAM OpenSCENARIO XML 1.0 to 1.3) as maps and recordings."""

from __future__ import annotations

import ast
import copy
import itertools
import math
import operator
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.converters.naming import map_name
from scex_sumo.converters.registries import Dataset, MapFormat, Recording, Window
from scex_sumo.converters.tracks.road_users import MOTOR_TYPES
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.converters.xml import unpacked, xml_root
from scex_sumo.formats.damage import MAX_ITEMS, refusing_damage
from scex_sumo.formats.opendrive.lanes import opendrive_map, read_opendrive
from scex_sumo.formats.opendrive.ways import Places
from scex_sumo.formats.openscenario.motion import BODIES, Mover, UnknownMotion
from scex_sumo.formats.openscenario.story import Storyboard
from scex_sumo.formats.recognition import is_openscenario
from scex_sumo.formats.samples.boxes import box_table
from scex_sumo.formats.samples.from_car import within_map
from scex_sumo.scene import SeedScene

MAX_S, AFTER_S = 600.0, 10.0  # of a scenario without an end, and after the last story
_WHAT, _REMEDY = "scenario of OpenSCENARIO", "export the scenario again"
_DEFAULTS = (*BODIES, "Maneuver", "Trajectory", "Route")  # their values are overruled by a reference
_NAME = re.compile(r"\$(\w+)")
_LETTERS = 1000  # of an expression
_OPERATORS: Mapping[type, Any] = {
    **{ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul},
    **{ast.Div: operator.truediv, ast.USub: operator.neg},
}
_FUNCTIONS: Mapping[str, Any] = {
    **{name: getattr(math, name) for name in ("floor", "ceil", "sqrt", "pow")},
    **{"round": round, "min": min, "max": max, "abs": abs},
}


def _map_of(path: Path) -> Path:
    with refusing_damage(MapError, path, _WHAT):
        file = _document(path).find("RoadNetwork/LogicFile")
        name = "" if file is None else file.get("filepath", "")
        if not name.lower().endswith((".xodr", ".xodr.gz")):
            raise ValueError(f"its road network is {name[-60:]!r}, no OpenDRIVE file")
        return path.parent / name.replace("\\", "/")


def _read(
    paths: Sequence[Path], *, window: Window = (None, None), **_: Any
) -> tuple[TrackTable, tuple[str, ...]]:
    """Drive a scenario's own actions; samples every 0.1 s, until it is not known any more."""
    path, map_path, end_s = paths[0], _map_of(paths[0]), min(MAX_S, window[1] or MAX_S)
    labels: list[str] = []
    values: list[tuple[float, ...]] = []
    notes: list[str] = []
    with refusing_damage(TrackError, path, _WHAT):
        drawn = opendrive_map(map_path, xml_root(map_path, remedy="export the map again"))
        story = Storyboard(_document(path), Places(drawn))
        numbers = _numbers(story.movers.values())
        for k in itertools.count():
            there = [mover for mover in story.movers.values() if mover.there]
            over_s = max((event.ended_s for event in story.events), default=0.0)
            is_over = k / 10 > min(end_s, over_s + AFTER_S)
            if not there or is_over or len(values) > MAX_ITEMS // 8:
                break
            labels += [numbers[mover.name] for mover in there]
            values += [(100.0 * k, *mover.sample()) for mover in there]
            try:
                story.go_on()
                story.go_on()
            except UnknownMotion as why:
                known_s = math.floor(10 * story.time_s + 1e-6) / 10
                notes += [f"the scenario is known until {known_s:g} s: {why}"] if str(why) else []
                break
        kinds = {numbers[mover.name]: mover.kind for mover in story.movers.values()}
        table = box_table(path, labels, kinds, np.array(values).reshape(-1, 8))
        table = replace(table, complete=partial(_completed, {label: name for name, label in numbers.items()}))
        return table, (*notes, *table.notes)


def _document(path: Path) -> Element:
    """Return the root of a scenario, with its parameters and catalogs filled in."""
    root = xml_root(path, remedy=_REMEDY)
    if root.tag != "OpenSCENARIO" or root.find("Storyboard") is None or root.find("Catalogs") is not None:
        raise ValueError("it is no scenario of OpenSCENARIO XML 1.0 to 1.3")  # 0.9 names its catalogs so
    entries: dict[tuple[str, ...], Element] = {}
    places = root.iterfind("CatalogLocations/*/Directory")
    folders = [path.parent / place.get("path", "") for place in places]
    for file in (file for folder in folders for file in sorted(folder.glob("*.xosc"))):
        for catalog in xml_root(file, remedy=_REMEDY).iter("Catalog"):
            for entry in catalog:
                entries.setdefault((catalog.get("name", ""), entry.get("name", "")), entry)
    _fill(root, {}, entries)
    return root


def _fill(element: Element, values: Mapping[str, str], entries: Mapping[tuple[str, ...], Element]) -> None:
    for declaration in element.findall("ParameterDeclarations/*"):
        name, value = _bare(declaration, "name"), _filled(declaration.get("value", ""), values)
        values = {name: value, **values} if element.tag in _DEFAULTS else {**values, name: value}
    for key, text in element.items():
        element.set(key, _filled(text, values))
    for k, child in enumerate(element):
        if child.tag == "CatalogReference":
            entry = tuple(_filled(child.get(key, ""), values) for key in ("catalogName", "entryName"))
            if entry in entries:
                element[k] = copy.deepcopy(entries[entry])
                refs, own = child.iter("ParameterAssignment"), element[k].iterfind("ParameterDeclarations/*")
                given = {_bare(x, "parameterRef"): _filled(x.get("value", ""), values) for x in refs}
                outer = {x: values[x] for x in {*values} - {_bare(x, "name") for x in own}}
                _fill(element[k], outer | given, entries)
            elif element.tag in ("ScenarioObject", "ManeuverGroup"):  # others matter less, as a controller
                raise ValueError(f"entry {entry[1]} of catalog {entry[0]} is in none of its catalog folders")
        elif child.tag != "ParameterDeclarations":
            _fill(child, values, entries)


def _bare(element: Element, key: str) -> str:
    return element.get(key, "").lstrip("$")


def _filled(text: str, values: Mapping[str, str]) -> str:
    def value(name: re.Match[str]) -> str:
        if name[1] not in values:
            raise ValueError(f"parameter {name[1][:40]} is not declared")
        return values[name[1]]

    if not text.startswith("$"):
        return {"True": "true", "False": "false"}.get(text, text)  # as Python's tools wrote them
    plain = _NAME.sub(value, text.removeprefix("${").removesuffix("}"))
    if not text.startswith("${"):
        return plain
    try:
        return str(_result(ast.parse(plain[:_LETTERS].strip(), mode="eval").body))
    except (ArithmeticError, LookupError, SyntaxError, TypeError, ValueError):
        return text  # names have some, too; where a number is needed, it is none


def _result(node: ast.AST) -> Any:
    match node:
        case ast.Constant(value=int() | float() as value):
            return value
        case ast.BinOp(left=left, op=op, right=right):
            return _OPERATORS[type(op)](_result(left), _result(right))
        case ast.UnaryOp(op=op, operand=operand):
            return _OPERATORS[type(op)](_result(operand))
        case ast.Call(func=ast.Name(id=name), args=args):
            return _FUNCTIONS[name](*map(_result, args))
    raise ValueError


def _numbers(movers: Iterable[Mover]) -> dict[str, str]:
    """Return a label for each name: of vehicles the numbers in their names if all differ, else new ones."""
    names = [mover.name for mover in movers if mover.kind in MOTOR_TYPES]
    own = [(re.findall(r"[0-9]{1,9}$", name) or [""])[0].lstrip("0") for name in names]
    if "" in own or len({*own}) < len(own):
        own = [str(k) for k in range(1, len(own) + 1)]
    return {mover.name: mover.name for mover in movers} | dict(zip(names, own, strict=True))


def _completed(names: Mapping[str, str], scene: SeedScene) -> SeedScene:
    vehicles = {str(track): names.get(str(track), str(track)) for track in scene.track_ids}
    vehicles = {} if all(name.endswith(track) for track, name in vehicles.items()) else vehicles
    return replace(scene, source={"kind": "scenario", "vehicles": vehicles})


def _recordings(files: Sequence[Path]) -> Iterator[Recording]:
    for path in files:
        name, site = map_name(path), map_name(_map_of(path))
        yield Recording(name=name, site=site, dataset="openscenario", map_path=path, track_paths=(path,))


OPENSCENARIO_MAP = MapFormat(
    is_mine=is_openscenario,
    read=lambda path, **_: read_opendrive(_map_of(path)),
    tracks=lambda path: path,
    asks_for="--tracks LOG.csv",
    opendrive=lambda path: unpacked(_map_of(path)),
)
OPENSCENARIO = Dataset(
    is_mine=is_openscenario, read=_read, recordings=_recordings, within=within_map, simulated=True
)
