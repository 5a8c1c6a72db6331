"""Scenario as written: its parameters and catalogs filled in, its entities, its map.

Source: ASAM OpenSCENARIO XML 1.0 to 1.3.
"""

from __future__ import annotations

import ast
import copy
import math
import operator
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from scex_sumo.converters.xml import xml_root
from scex_sumo.formats.opendrive.reference import number

_KINDS = {"motorbike": "motorcycle", "van": "car", "semitrailer": "truck"}
_BODIES = {"Vehicle": "car", "Pedestrian": "pedestrian", "MiscObject": "object"}
_DEFAULTS = (*_BODIES, "Maneuver", "Trajectory", "Route")  # their values are overruled by a reference
_NAME = re.compile(r"\$(\w+)")
_REMEDY = "export the scenario again"
_LETTERS = 1000  # of an expression
_OPERATORS: Mapping[type, Any] = {
    **{ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul},
    **{ast.Div: operator.truediv, ast.USub: operator.neg},
}
_FUNCTIONS: Mapping[str, Any] = {
    **{name: getattr(math, name) for name in ("floor", "ceil", "sqrt", "pow")},
    **{"round": round, "min": min, "max": max, "abs": abs},
}


@dataclass(frozen=True, kw_only=True)
class Entity:
    """Road user of a scenario; its box's centre is ``ahead_m`` ahead and ``left_m`` left of its reference.

    Attributes:
        speeds: at the vertices of its trajectory, m/s, where our own export wrote the file.
    """

    name: str
    kind: str
    length: float
    width: float
    ahead_m: float
    left_m: float
    is_controlled: bool
    speeds: tuple[float, ...]


def read_document(path: Path) -> tuple[Element, dict[str, Entity]]:
    """Read a scenario; return its root, filled in, and its entities by name.

    Raises:
        ValueError, ScexError: it is damaged, or names a parameter or an entry that is not there.
    """
    root = xml_root(path, remedy=_REMEDY)
    if root.tag != "OpenSCENARIO" or root.find("Storyboard") is None:
        raise ValueError("it is no scenario of OpenSCENARIO XML")
    folders = [path.parent / one.get("path", "") for one in root.iterfind("CatalogLocations/*/Directory")]
    _Filler(file for folder in folders for file in sorted(folder.glob("*.xosc"))).fill(root, {})
    entities = [_entity(one) for one in root.iterfind("Entities/ScenarioObject")]
    return root, {one.name: one for one in entities}


def map_of(path: Path) -> Path:
    """Return the OpenDRIVE file that a scenario names; raises `ValueError` if it names none."""
    file = read_document(path)[0].find("RoadNetwork/LogicFile")
    name = "" if file is None else file.get("filepath", "")
    if not name.lower().endswith((".xodr", ".xodr.gz")):
        raise ValueError(f"its road network is {name[-60:]!r}, no OpenDRIVE file")
    return path.parent / name.replace("\\", "/")


class _Filler:
    """Fills parameters and entries of catalogs into elements."""

    def __init__(self, files: Iterable[Path]) -> None:
        self._entries: dict[tuple[str | None, str | None], Element] = {}
        for catalog in (one for file in files for one in xml_root(file, remedy=_REMEDY).iter("Catalog")):
            for entry in catalog:
                self._entries.setdefault((catalog.get("name"), entry.get("name")), entry)

    def fill(self, element: Element, values: Mapping[str, str]) -> None:
        """Replace parameters in attributes, and references to catalogs by their entries."""
        for one in element.findall("ParameterDeclarations/*"):
            name, value = one.get("name", "").lstrip("$"), _filled(one.get("value", ""), values)
            values = {name: value} | dict(values) if element.tag in _DEFAULTS else {**values, name: value}
        for key, text in element.items():
            element.set(key, _filled(text, values))
        for k, child in enumerate(element):
            if child.tag == "CatalogReference":
                element[k] = self._entry(child, values, element.tag)
            elif child.tag != "ParameterDeclarations":
                self.fill(child, values)

    def _entry(self, reference: Element, values: Mapping[str, str], within: str) -> Element:
        catalog, name = (_filled(reference.get(key, ""), values) for key in ("catalogName", "entryName"))
        if (catalog, name) not in self._entries:
            if within in ("ScenarioObject", "ManeuverGroup"):
                raise ValueError(f"entry {name} of catalog {catalog} is in none of its catalog folders")
            return reference  # such as a controller's
        entry = copy.deepcopy(self._entries[catalog, name])
        given = [
            (x.get("parameterRef", ""), x.get("value", "")) for x in reference.iter("ParameterAssignment")
        ]
        self.fill(entry, {name.lstrip("$"): _filled(value, values) for name, value in given})
        return entry


def _filled(text: str, values: Mapping[str, str]) -> str:
    def value(name: re.Match[str]) -> str:
        if name[1] not in values:
            raise ValueError(f"parameter {name[1][:40]} is not declared")
        return values[name[1]]

    if not text.startswith("$"):
        return text
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


def _entity(element: Element) -> Entity:
    body = next((one for one in element if one.tag in _BODIES), None)
    if body is None:
        raise ValueError(f"entity {element.get('name')} is no vehicle, pedestrian or object")
    kind = body.get("vehicleCategory", "") or _BODIES[body.tag]
    size, centre = body.find("BoundingBox/Dimensions"), body.find("BoundingBox/Center")
    length, width = (math.nan if size is None else number(size, name) for name in ("length", "width"))
    ahead, left = (0.0 if centre is None else number(centre, axis) for axis in ("x", "y"))
    speeds = body.find("Properties/Property[@name='speeds_mps']")
    return Entity(
        name=element.get("name", ""),
        kind=_KINDS.get(kind, kind),
        length=length,
        width=width,
        ahead_m=ahead,
        left_m=left,
        is_controlled=element.find("ObjectController") is not None,
        speeds=() if speeds is None else tuple(map(float, speeds.get("value", "").split())),
    )
