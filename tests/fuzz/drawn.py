"""Cases of formats with lane polylines: Argoverse 2, ScenarioNet's pickles, 123D's Arrow files, openDD."""

from __future__ import annotations

import json
import pickle
import pickletools
import sqlite3
import warnings
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from random import Random
from typing import Any

import msgpack
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.formats import test_argoverse, test_opendd, test_py123d, test_scenarionet
from tests.fuzz.mutations import (
    NUMBERS,
    VALUES,
    WORDS,
    bytes_changed,
    mutated,
    read_table,
    value_changed,
    write_table,
)
from tests.fuzz.weights import EXECUTED

Made = tuple[str, list[str]]
"""How the input was mutated, and the command without its options."""


def _shared(value: Any) -> Any:
    """Ten billion items in a few bytes."""
    for _ in range(10):
        value = [value] * 10
    return value


def _endless() -> list[Any]:
    one: list[Any] = []
    one += [one, one]
    return one


ARRAYS: tuple[Any, ...] = (
    *(
        np.zeros(0),
        np.zeros((0, 2)),
        np.zeros(()),
        np.zeros((2, 2, 2)),
        np.zeros((0, 2**40)),
        np.zeros(7, np.int8),
    ),
    *(np.full((3, 2), np.nan), np.full((61, 3), 1e300), np.full(61, -1e-300), np.arange(61.0)[::-1]),
    *(np.array(["x", "y"]), np.zeros(61, bool), np.zeros(3, complex), np.float32("inf"), np.int64(2**62)),
    *(_shared(0.0), _shared("LANE"), _endless(), {1: "x"}, b"x", (1, 2), {"x"}, float("nan")),
)
SNIPPETS = (
    f"cos\nmkdir\n(V{EXECUTED}\ntR0".encode(),
    f"cbuiltins\nexec\n(Vimport os; os.mkdir('{EXECUTED}')\ntR0".encode(),
    f"cnumpy.lib.npyio\nDataSource\n(V{EXECUTED}\ntR0".encode(),
    b"Nr" + (10**8).to_bytes(4, "little") + b"0",  # a memo of 100 million places
    b"\x96" + (10**10).to_bytes(8, "little"),  # 10 GB of bytes, as it says
    b"\x8a\xff" + b"\x7f" * 255 + b"0",
    b"cnumpy\nndarray\n(K\x01\x85VO\nC\x08AAAAAAAAtR0",
    b"(" * 5000,
    *(b"\x85" * 5000, b"cnumpy\ndtype\nbcnumpy\ndtype\nR0", b"}b", b"2", b"0", b"R", b"a", b"u"),
)
"""Opcodes that run code, reserve memory, or leave the stack in disorder."""


def scenarionet(work: Path, rng: Random) -> Made:
    """A scenario of ScenarioNet with other values, or with other opcodes."""
    content = test_scenarionet.content()
    how = []
    for _ in range(rng.choice((0, 1, 1, 2))):
        below = rng.choice(
            (content, content["tracks"], content["map_features"], content["dynamic_map_states"])
        )
        how.append(
            _array_changed(below, rng)
            if rng.random() < 0.3
            else value_changed(below, rng, (*VALUES, *ARRAYS))
        )
    path = work / "sd_waymo_v1_a.pkl"
    path.write_bytes(pickle.dumps(content, protocol=rng.choice((2, 3, 4, 5))))
    if not how or rng.random() < 0.2:
        how.append(_opcodes_changed(path, rng))
    commands = [["run", path.name, "--time", "2"], ["inspect", path.name]]
    commands += [["convert", path.name, "-o", "new.net.xml"]]
    commands += [["convert", path.name, "--signals", path.name, "-o", "new.net.xml"]]
    return "; ".join(how), rng.choice(commands)


def _array_changed(content: Any, rng: Random) -> str:
    """Change numbers, the length or the type of one array of many."""
    path, at, key = rng.choice(list(_arrays("$", content)))
    array = np.array(at[key])
    what = rng.choice(("numbers", "cut", "type", "turned", "one"))
    if what == "numbers":
        array = array.astype(float)
        array.flat[rng.randrange(array.size)] = rng.choice((np.nan, np.inf, 1e300, -1.0, 1e8, 0.0))
    elif what == "type":
        array = array.astype(rng.choice(("f2", "i1", "u8", "S3", "U9", "?", "c8")))
    else:
        array = {"cut": array[: len(array) // 2], "turned": array.T[::-1], "one": array[:1]}[what]
    at[key] = array
    return f"{what} of {path}"


def _arrays(path: str, at: Any) -> Any:
    for key, value in at.items() if isinstance(at, dict) else ():
        if isinstance(value, np.ndarray) and value.ndim:
            yield f"{path}.{key}", at, key
        yield from _arrays(f"{path}.{key}", value)


def _opcodes_changed(path: Path, rng: Random) -> str:
    """Drop, double, swap or insert opcodes of a pickle."""
    content = path.read_bytes()
    if rng.random() < 0.2:
        return mutated(path, rng)
    places = [at for _, _, at in pickletools.genops(content)] + [len(content)]
    k = rng.randrange(len(places) - 1)
    one = content[places[k] : places[k + 1]]
    what = rng.choice(("drop", "double", "swap", "insert", "insert", "insert"))
    if what == "swap":
        other = rng.randrange(len(places) - 1)
        new = content[places[other] : places[other + 1]]
    else:
        new = {"drop": b"", "double": one + one, "insert": rng.choice(SNIPPETS) + one}[what]
    path.write_bytes(content[: places[k]] + new + content[places[k + 1] :])
    return f"{what} opcode {k} {new[:20]!r}"


def argoverse(work: Path, rng: Random) -> Made:
    """A scenario of Argoverse 2, or a log of its sensor dataset."""
    is_log = rng.random() < 0.4
    folder = work / "map" if is_log else work
    folder.mkdir(exist_ok=True)
    map_path = folder / "log_map_archive_abcdefgh-1.json"
    map_path.write_text(json.dumps(test_argoverse.map_content()))
    if is_log:
        ego = rng.random() < 0.5
        tracks = test_argoverse.sensor_log(work, f"annotations{'_with_ego' * ego}.feather", ego=ego)
        files = [map_path, tracks, work / "city_SE3_egovehicle.feather"]
    else:
        tracks = work / "scenario_abcdefgh-1.parquet"
        pq.write_table(pa.table(test_argoverse.columns()), tracks)
        files = [map_path, tracks, tracks]
    file = rng.choice(files)
    how = f"{file.name}: {mutated(file, rng)}"
    name = str(map_path.relative_to(work))
    commands = [["run", name, "--time", "2"], ["inspect", name], ["convert", name, "-o", "new.net.xml"]]
    return how, rng.choice(commands)


def py123d(work: Path, rng: Random) -> Made:
    """A log of 123D: columns, packed metadata or packed lanes of one of its files."""
    folder = work / "logs/made_val/one"
    test_py123d.write_map(folder / "map.arrow")
    sync = test_py123d.write_log(folder, label=rng.choice(("NuPlan", "WODMotion", "NuScenes")))
    file = rng.choice(sorted(folder.glob("*.arrow")))
    way: Callable[[Path, Random], str] = rng.choice((mutated, _packed_metadata_changed, _packed_lane_changed))
    if way is _packed_lane_changed:
        file = folder / "map.arrow"
    how = f"{file.name}: {way(file, rng)}"
    name = str(sync.relative_to(work))
    commands = [["run", name, "--time", "2"], ["inspect", name], ["convert", name, "-o", "new.net.xml"]]
    commands += [["convert", name, "--signals", name, "-o", "new.net.xml"]]
    return how, rng.choice(commands)


_PACKABLE = tuple(value for value in VALUES if not isinstance(value, int) or abs(value) < 2**63)


def _repacked(packed: bytes, rng: Random) -> tuple[str, bytes]:
    content = msgpack.unpackb(packed, raw=False, strict_map_key=False)
    values = (
        *_PACKABLE,
        [[1.0, 2.0]] * 3,
        float("nan"),
        {b"__ndarray__": True, b"dtype": "|O", b"shape": [1]},
    )
    how = value_changed(content, rng, values)
    return how, msgpack.packb(content)


def _packed_metadata_changed(file: Path, rng: Random) -> str:
    table = read_table(file)
    packed = table.schema.metadata[b"metadata"]
    if packed == msgpack.packb({}):
        return mutated(file, rng)
    how, packed = _repacked(packed, rng)
    write_table(table.replace_schema_metadata({b"metadata": packed}), file)
    return f"metadata {how}"


def _packed_lane_changed(file: Path, rng: Random) -> str:
    table = read_table(file)
    column = table["features"].to_pylist()
    row = rng.randrange(len(column))
    how, column[row] = _repacked(column[row], rng)
    at = table.column_names.index("features")
    write_table(table.set_column(at, "features", pa.array(column)), file)
    return f"{row} {how}"


def opendd(work: Path, rng: Random) -> Made:
    """A place of openDD: bytes of a database, or values and columns of its tables."""
    place = test_opendd.write_place(work)
    map_path, tracks = place / "rdb1/map_rdb1/map_rdb1.sqlite", place / "trajectories_rdb1_v3.sqlite"
    file = rng.choice((map_path, tracks))
    how = bytes_changed(file, rng) if rng.random() < 0.2 else _cell_changed(file, rng)
    name = str(map_path.relative_to(work))
    commands = [["run", name, "--time", "2"], ["inspect", name], ["convert", name, "-o", "new.net.xml"]]
    return f"{file.name}: {how}", rng.choice(commands)


def _cell_changed(file: Path, rng: Random) -> str:
    """Change some rows of a column of an SQLite file, or drop or rename it."""
    with closing(sqlite3.connect(file)) as base, base:
        table = rng.choice([name for (name,) in base.execute("SELECT name FROM sqlite_master")])
        column = rng.choice([row[1] for row in base.execute(f"PRAGMA table_info({table})")])
        what = rng.choice(("set", "set", "set", "scale", "rename", "empty"))
        if what == "rename":
            base.execute(f"ALTER TABLE {table} RENAME COLUMN {column} TO other")
        elif what == "empty":
            base.execute(f"DELETE FROM {table}")
        elif what == "scale":
            base.execute(f"UPDATE {table} SET {column} = {column} * {rng.choice((-1, 1e-3, 1e6, 1e300))}")
        else:
            value = rng.choice((None, b"\xff", 1e300, float("inf"), 2**62, *NUMBERS, *WORDS))
            rows = rng.choice(("1", "rowid % 7 = 3", "rowid = 2"))
            base.execute(f"UPDATE {table} SET {column} = ? WHERE {rows}", (value,))
    return f"{what} {table}.{column}"


_OSI_VALUES = (
    0,
    1,
    -1,
    2**31 - 1,
    2**32 - 1,
    str(2**63 - 1),
    0.5,
    -3.0,
    1e300,
    "NaN",
    "Infinity",
    "x" * 5000,
    {},
    [],
)


def trace(file: Path, rng: Random) -> str:
    """Change values of some messages of a trace of OSI, in place."""
    import betterosi
    from mcap.reader import make_reader

    packed = file.suffix == ".mcap"
    with file.open("rb") as stream:
        if packed:
            read = [(s.name.rpartition(".")[2], m) for s, _, m in make_reader(stream).iter_messages() if s]
            messages = [(getattr(betterosi, kind).from_binary(m.data), m.log_time) for kind, m in read]
        else:
            messages = []
            while size := stream.read(4):
                body = stream.read(int.from_bytes(size, "little"))
                messages.append((betterosi.GroundTruth.from_binary(body), 0))
    how = []
    for _ in range(rng.choice((1, 3, 30))):
        k = rng.randrange(len(messages))
        content = json.loads(messages[k][0].to_json())
        how.append(value_changed(content, rng, _OSI_VALUES))
        with suppress(Exception):  # no value of that field
            messages[k] = type(messages[k][0]).from_json(json.dumps(content)), messages[k][1]
    if packed:
        with warnings.catch_warnings(), betterosi.Writer(str(file)) as writer:
            warnings.simplefilter("ignore")  # a version that is none
            for message, time in messages:
                is_map = isinstance(message, betterosi.MapAsamOpenDrive)
                writer.add(message, topic="ground_truth_map" if is_map else None, log_time=time)
    else:
        bodies = [message.to_binary() for message, _ in messages]
        file.write_bytes(b"".join(len(body).to_bytes(4, "little") + body for body in bodies))
    return "; ".join(how)[:80]
