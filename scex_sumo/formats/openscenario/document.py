"""Scenario as written (ASAM OpenSCENARIO XML 1.0 to 1.3): its parameters and catalogs filled in, its map."""

from __future__ import annotations

import ast
import copy
import math
import operator
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from scex_sumo.converters.xml import xml_root
from scex_sumo.formats.openscenario.motion import BODIES

_DEFAULTS = (*BODIES, "Maneuver", "Trajectory", "Route")  # their values are overruled by a reference
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


def read_document(path: Path) -> Element:
    """Read a scenario; return its root, filled in.

    Raises:
        ValueError, ScexError: it is damaged, or names a parameter or an entry that is not there.
    """
    root = xml_root(path, remedy=_REMEDY)
    if root.tag != "OpenSCENARIO" or root.find("Storyboard") is None:
        raise ValueError("it is no scenario of OpenSCENARIO XML")
    entries: dict[tuple[str, ...], Element] = {}
    folders = [path.parent / one.get("path", "") for one in root.iterfind("CatalogLocations/*/Directory")]
    for file in (file for folder in folders for file in sorted(folder.glob("*.xosc"))):
        for catalog in xml_root(file, remedy=_REMEDY).iter("Catalog"):
            for entry in catalog:
                entries.setdefault((catalog.get("name", ""), entry.get("name", "")), entry)
    _fill(root, {}, entries)
    return root


def _fill(element: Element, values: Mapping[str, str], entries: Mapping[tuple[str, ...], Element]) -> None:
    for one in element.findall("ParameterDeclarations/*"):
        name, value = one.get("name", "").lstrip("$"), _filled(one.get("value", ""), values)
        values = {name: value, **values} if element.tag in _DEFAULTS else {**values, name: value}
    for key, text in element.items():
        element.set(key, _filled(text, values))
    for k, child in enumerate(element):
        if child.tag == "CatalogReference":
            entry = tuple(_filled(child.get(key, ""), values) for key in ("catalogName", "entryName"))
            if entry in entries:
                given = [
                    (x.get("parameterRef", ""), x.get("value", "")) for x in child.iter("ParameterAssignment")
                ]
                element[k] = copy.deepcopy(entries[entry])
                _fill(element[k], {name.lstrip("$"): _filled(text, values) for name, text in given}, entries)
            elif element.tag in ("ScenarioObject", "ManeuverGroup"):  # others matter less, as a controller
                raise ValueError(f"entry {entry[1]} of catalog {entry[0]} is in none of its catalog folders")
        elif child.tag != "ParameterDeclarations":
            _fill(child, values, entries)


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
