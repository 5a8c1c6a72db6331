"""Schemas of JSON from outside: types, ranges, names; numbers are finite and of 64 bits.

The words are those of JSON Schema, as far as `faults` reads them.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, TypeAlias

from scex_sumo.base.errors import ResultError, one_line

Schema: TypeAlias = Mapping[str, Any]

TEXT: Final[Schema] = {"type": "string"}
NUMBER: Final[Schema] = {"type": "number"}
COUNT: Final[Schema] = {"type": "integer", "minimum": 0, "maximum": 10**9}
TRACK: Final[Schema] = {"type": "integer"}
SHARE: Final[Schema] = {"type": "number", "minimum": 0, "maximum": 1}
PLAIN_NAME: Final[Schema] = {"type": "string", "pattern": r"^(?!\.{0,2}$)[^/\\\0]*$"}
"""A file's name, which leads into no other folder."""


def listed(items: Schema, least: int = 0, most: int | None = None) -> Schema:
    """Return the schema of a list."""
    return {"type": "array", "items": items, "minItems": least} | ({} if most is None else {"maxItems": most})


def record(required: Mapping[str, Schema], more: Mapping[str, Schema] | None = None) -> Schema:
    """Return the schema of an object with some members, maybe ``more``, and others that nobody reads."""
    return {"type": "object", "required": [*required], "properties": {**required, **(more or {})}}


def or_null(schema: Schema) -> Schema:
    """Return a schema that null fits, too."""
    return {**schema, "type": [schema["type"], "null"]}


def read_json(file: Path, schema: Schema, remedy: str) -> Any:
    """Return the content of a JSON file that fits a schema; else raise a `ResultError`."""
    try:
        return parse_json(file.read_bytes(), schema)
    except OSError as cause:
        raise ResultError(f"{file}: cannot be read: {cause.strerror or cause}; {remedy}") from None
    except ValueError as cause:
        raise ResultError(f"{file}: {one_line(cause)[:160]}; {remedy}") from None


def parse_json(text: bytes | str, schema: Schema) -> Any:
    """Return JSON that fits a schema; else raise a ValueError that says where it does not."""
    try:
        content = json.loads(text)
        fault = next(faults(content, schema), None)
    except (ValueError, RecursionError) as cause:
        raise ValueError(f"not JSON ({one_line(cause)[:80]})") from None
    if fault is not None:
        raise ValueError(fault)
    return content


def faults(value: Any, schema: Schema, place: str = "") -> Iterator[str]:
    """Yield where a value does not fit a schema, got and needed."""
    kinds = schema.get("type", ())
    kinds = [kinds] if isinstance(kinds, str) else kinds
    got = f"{place or 'the content'} is {json.dumps(value)[:40]}"
    if kinds and not any(_IS[kind](value) for kind in kinds):
        yield f"{got}, needs {' or '.join(kinds)}"
        return
    if "const" in schema and value != schema["const"]:
        yield f"{got}, needs {schema['const']!r}"
    elif "enum" in schema and value not in schema["enum"]:
        yield f"{got}, needs one of {', '.join(map(str, schema['enum']))}"
    elif isinstance(value, str) and not re.search(schema.get("pattern", ""), value):
        yield f"{got}, needs the pattern {schema['pattern']}"
    elif isinstance(value, int | float):
        yield from (f"{got}, needs {words}" for words in _beyond(value, schema))
    elif isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", math.inf):
            yield f"{place} has {len(value)} entries"
        if "items" in schema:
            for index, entry in enumerate(value):
                yield from faults(entry, schema["items"], f"{place}[{index}]")
    elif isinstance(value, dict):
        yield from _of_members(value, schema, place)


def _of_members(value: dict[str, Any], schema: Schema, place: str) -> Iterator[str]:
    known, others = schema.get("properties", {}), schema.get("additionalProperties", True)
    for name, member in value.items():
        where = f"{place}.{name[:40]}".lstrip(".")
        if name in known or isinstance(others, Mapping):
            yield from faults(member, known.get(name, others), where)
        elif not others:
            yield f"{where} is unknown"
        if "propertyNames" in schema:
            yield from faults(name, schema["propertyNames"], f"the name {name[:40]!r}")
    missing = [name for name in schema.get("required", ()) if name not in value]
    yield from (f"has no {f'{place}.{name}'.lstrip('.')}" for name in missing)


def _beyond(value: float, schema: Schema) -> Iterator[str]:
    if value < schema.get("minimum", value):
        yield f"at least {schema['minimum']:g}"
    if value <= schema.get("exclusiveMinimum", -math.inf):
        yield f"more than {schema['exclusiveMinimum']:g}"
    if value > schema.get("maximum", value):
        yield f"at most {schema['maximum']:g}"


def _is_number(value: Any) -> bool:
    return _is_integer(value) or (isinstance(value, float) and math.isfinite(value))


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**63


_IS = {
    "object": lambda value: isinstance(value, dict),
    "array": lambda value: isinstance(value, list),
    "string": lambda value: isinstance(value, str),
    "boolean": lambda value: isinstance(value, bool),
    "null": lambda value: value is None,
    "integer": _is_integer,
    "number": _is_number,
}
