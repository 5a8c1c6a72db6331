"""Mutations of files: seeded, by bytes, by the words of text formats, and by the structure of tables."""

from __future__ import annotations

import gzip
import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

NUMBERS = (
    *("0", "-1", "1e300", "-1e300", "nan", "inf", "-inf", "NA", "null", "", "0.1", "1e-300", "980", " 7 "),
    *("2147483648", "9007199254740993", "9223372036854775808", "99999999999999999999999"),
    *("1,5", "1_000", "0x10", "--1"),
)
WORDS = (
    *("", "\u00e9", "\ud55c\uad6d", "lorry", "a" * 5000, "../../x", "%s%n", "<", "&amp;", "'", '"', "None"),
    "\u202e",
)
VALUES: tuple[Any, ...] = (
    *(None, True, 0, -1, 1.5, 1e300, 2**53 + 1, 2**63, 10**30, "", "x", "../../x", "9" * 5000),
    *([], {}, [[]], {"": None}),
)


def mutated(file: Path, rng: Random) -> str:
    """Mutate a file in place once; says how."""
    kind = file.name.removesuffix(".gz").rpartition(".")[2]
    ways: list[Callable[[Path, Random], str]] = [bytes_changed]
    if kind in ("csv", "osm", "xml", "xosc", "xodr", "kml"):
        ways = [bytes_changed, _text, _text, _text, _text]
    if kind == "csv":
        ways += [_column] * 6
    elif kind == "json":
        ways = [bytes_changed, *[_json] * 6]
    elif kind in ("parquet", "feather", "arrow"):
        ways = [bytes_changed, *[_table] * 6]
    try:
        return rng.choice(ways)(file, rng)
    except (ValueError, LookupError, OSError, pa.ArrowException):  # the first mutation left no such structure
        return bytes_changed(file, rng)


BYTES = ("flip", "cut", "drop", "double", "garbage", "empty", "pack")


def bytes_changed(file: Path, rng: Random, ways: Sequence[str] = BYTES) -> str:
    """Change a file's bytes in one of some ways, whatever they mean; says how."""
    content = bytearray(file.read_bytes())
    at, size = rng.randrange(len(content) + 1), rng.choice((1, 4, 100, 5000))
    what = rng.choice(ways)
    if what == "flip":
        for _ in range(min(size, len(content))):
            content[rng.randrange(len(content))] = rng.randrange(256)
    elif what == "zero":
        content[at : at + size] = bytes(len(content[at : at + size]))
    elif what == "cut":
        del content[at:]
    elif what == "drop":
        del content[at : at + size]
    elif what == "double":
        content[at:at] = content[at : at + size]
    elif what == "garbage":
        content[at:at] = rng.randbytes(size)
    elif what == "empty":
        content = bytearray()
    else:
        content = bytearray(gzip.compress(bytes(content)))
    file.write_bytes(content)
    return f"{what} {size} bytes"


def _text(file: Path, rng: Random) -> str:
    text = file.read_text(encoding="utf-8", errors="surrogateescape")
    lines = text.split("\n")
    what = rng.choice(
        ("number", "number", "numbers", "word", "swap", "drop", "double", "ends", "marks", "ids")
    )
    if what in ("number", "numbers"):
        new, share = rng.choice(NUMBERS), 1 if what == "number" else 50
        places = list(re.finditer(r"-?\d+\.?\d*", text))
        for place in sorted(rng.sample(places, min(share, len(places))), key=lambda m: -m.start()):
            text = text[: place.start()] + new + text[place.end() :]
    elif what == "word":
        words = sorted(set(re.findall(r"[A-Za-z_]{2,}", text)))
        text = text.replace(rng.choice(words), rng.choice((*WORDS, rng.choice(words))))
    elif what == "ids":
        ids = sorted(set(re.findall(r"'(-?\d+)'|\"(-?\d+)\"", text)))[:2000] or [("1", "")]
        one, other = (max(rng.choice(ids)) for _ in range(2))
        text = text.replace(f'"{one}"', f'"{other}"').replace(f"'{one}'", f"'{other}'")
    elif what == "ends":
        text = text.replace("\n", rng.choice(("\r", "\r\n", "\n\n", "")))
    elif what == "marks":
        text = text.replace(",", rng.choice((";", "\t", ",,", " ,")))
    else:
        a, b = sorted(rng.randrange(len(lines)) for _ in range(2))
        b = min(b, a + 200)
        if what == "swap":
            lines[a], lines[b] = lines[b], lines[a]
        elif what == "drop":
            del lines[a:b]
        else:
            lines[a:a] = lines[a:b]
        text = "\n".join(lines)
    file.write_text(text, encoding="utf-8", errors="surrogateescape", newline="")
    return what


def _column(file: Path, rng: Random) -> str:
    """A column of a CSV file set, scaled, shifted or dropped, in some rows or in all."""
    rows = [
        line.split(",") for line in file.read_text(encoding="utf-8", errors="surrogateescape").split("\n")
    ]
    column = rng.randrange(len(rows[0]))
    share = rng.choice((0.001, 0.05, 1.0))
    what = rng.choice(("set", "scale", "shift", "share", "drop"))
    name, value = rows[0][column], rng.choice((*NUMBERS, *WORDS))
    factor = rng.choice((1e-3, 1e3, -1.0, 1e6, 1e12, 0.0))
    others = [row[column] for row in rows[1:] if len(row) > column]
    for row in rows[0 if what == "drop" else 1 :]:
        if len(row) <= column or (what != "drop" and rng.random() > share):
            continue
        try:
            number = float(row[column])
        except ValueError:
            number = 1.0
        if what == "drop":
            del row[column]
        elif what == "set":
            row[column] = value
        elif what == "share":
            row[column] = rng.choice(others)
        else:
            row[column] = repr(number * factor if what == "scale" else number + factor)
    text = "\n".join(",".join(row) for row in rows)
    file.write_text(text, encoding="utf-8", errors="surrogateescape", newline="")
    return f"{what} {name[:12]} of {share:g}"


def _json(file: Path, rng: Random) -> str:
    content = json.loads(file.read_text())
    how = value_changed(content, rng)
    file.write_text(json.dumps(content))
    return how


def value_changed(content: Any, rng: Random, values: Sequence[Any] = VALUES) -> str:
    """Replace or drop a value somewhere in nested lists and dicts; says which."""
    at, path = content, "$"
    while at:
        key: Any = rng.choice(list(at)) if isinstance(at, dict) else rng.randrange(len(at))
        path += f".{key}"
        below = at[key]
        if not isinstance(below, dict | list) or not below or rng.random() < 0.3:
            break
        at = below
    if not at:
        return "empty"
    if rng.random() < 0.3:
        del at[key]
        path += " dropped"
    else:
        at[key] = rng.choice(values)
    return path[:40]


def read_table(file: Path) -> pa.Table:
    """Read a table of Parquet, Feather or Arrow."""
    if file.suffix == ".parquet":
        return pq.read_table(file)
    with pa.OSFile(str(file), "rb") as source:
        return pa.ipc.open_file(source).read_all()


def write_table(table: pa.Table, file: Path) -> None:
    """Write a table as the file's ending names."""
    if file.suffix == ".parquet":
        pq.write_table(table, file)
        return
    with pa.OSFile(str(file), "wb") as sink, pa.ipc.new_file(sink, table.schema) as writer:
        writer.write_table(table)


def column_changed(file: Path, rng: Random) -> str:
    """A column of a table dropped, of another type, with nulls, or with lists of other lengths."""
    table = read_table(file)
    name = rng.choice(table.column_names)
    at, column = table.column_names.index(name), table[name].combine_chunks()
    what = rng.choice(("drop", "type", "type", "null", "nulls", "lists"))
    if what == "drop":
        write_table(table.drop_columns([name]), file)
        return f"{what} {name}"
    if what == "lists" and not pa.types.is_list(column.type):
        name = next((field.name for field in table.schema if pa.types.is_list(field.type)), name)
        at, column = table.column_names.index(name), table[name].combine_chunks()
    values = column.to_pylist()
    if what == "type":
        kind, value = rng.choice(OTHER_TYPES)
        new = pa.array([value] * len(values), kind)
        what = f"type {kind}"
    elif what == "null":
        new = pa.nulls(len(values), column.type)
    elif what == "nulls":
        new = pa.array([None if rng.random() < 0.3 else value for value in values], column.type)
    else:
        longer = [value if isinstance(value, list) else [value] for value in values]
        longer = [rng.choice((value[:-1], value * 2, [], [None, *value], value)) for value in longer]
        new = pa.array(longer, column.type if pa.types.is_list(column.type) else pa.list_(column.type))
    write_table(table.set_column(at, name, new), file)
    return f"{what} {name}"


OTHER_TYPES: tuple[tuple[pa.DataType, Any], ...] = (
    *((pa.string(), "x"), (pa.string(), "1"), (pa.int8(), 1), (pa.int64(), 2**60), (pa.uint64(), 2**63)),
    *((pa.float32(), 0.5), (pa.float64(), float("nan")), (pa.bool_(), True), (pa.binary(), b"\xff")),
    *((pa.null(), None), (pa.date32(), 1), (pa.list_(pa.float64()), [1.0, None]), (pa.large_string(), "x")),
    (pa.struct([("a", pa.int64())]), {"a": 1}),
)


def _table(file: Path, rng: Random) -> str:
    """A column of a table changed, or full of one value; or some rows."""
    table = read_table(file)
    name, count = rng.choice(table.column_names), len(table)
    what = rng.choice(("column", "column", "column", "value", "number", "rows", "double", "shuffle"))
    if what == "column":
        return column_changed(file, rng)
    if what in ("value", "number"):
        value = rng.choice((float("nan"), float("inf"), 1e300, -1.0, 0.0))
        new = pa.array([value] * count) if what == "value" else pa.array(list(range(count)), pa.int32())
        table = table.set_column(table.column_names.index(name), name, new)
    elif what == "rows":
        table = table.slice(rng.randrange(count + 1), rng.randrange(count + 1))
    elif what == "double":
        table = pa.concat_tables([table, table])
    else:
        order = list(range(count))
        rng.shuffle(order)
        table = table.take(order)
    write_table(table, file)
    return f"{what} {name}"
