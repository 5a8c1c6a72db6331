"""The result folder: made whole or not at all, resumed after an interruption, read back as Arrow tables."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from scex_sumo.errors import ResultError
from scex_sumo.scene import BoolArray, FloatArray, IntArray, SeedScene, States

LOGGED_HISTORY = 10  # frames of an INTERACTION case up to and including the seed scene
_PENDING = "incomplete.json"
_PARTS = ".parts"


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """Some children of a run, ready to be logged.

    Attributes:
        children: (C,) their numbers.
        states: (C, T, V) simulated states.
        values: (C, 12) metric values.
        defined: (C, 12) False where a metric is defined in no scene of the child.
        worst: where each child's extremum came from, columns of ``worst.parquet``.
        plan_x: (C, R, V, H) centres planned at each of the R replans, m; None where plans are not kept.
        plan_y: (C, R, V, H) likewise.
        fallbacks: plans that are not the models' own, rows of ``fallbacks.parquet``; None for none.
        tested: (2, C, 12) values, and 1 where defined, of the vehicles under test alone; None without any.
    """

    children: IntArray
    states: States
    values: FloatArray
    defined: BoolArray
    worst: pa.Table
    plan_x: FloatArray | None = None
    plan_y: FloatArray | None = None
    fallbacks: pa.Table | None = None
    tested: FloatArray | None = None


class ResultFolder:
    """Writes a run into a folder.

    Until :meth:`finish`, the folder has ``incomplete.json`` and no ``run.json``; finished batches of children
    lie in a hidden folder, from which the same run goes on after an interruption.
    """

    def __init__(self, path: Path, configuration: Mapping[str, Any], *, overwrite: bool = False) -> None:
        self.path = path
        self.identity = hashlib.sha256(_json(configuration).encode()).hexdigest()
        self._claim(overwrite)

    def _claim(self, overwrite: bool) -> None:
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            found = self._found_identity()
            if found != self.identity:
                if found is not None and not overwrite:
                    raise ResultError(
                        f"{self.path}: holds the result of another run; give another folder with -o, "
                        "or --overwrite to replace it"
                    )
                if found is None and any(self.path.iterdir()):
                    raise ResultError(
                        f"{self.path}: not empty, and no result of scex-sumo; give another folder with -o"
                    )
                self._clear()
            (self.path / _PARTS).mkdir(exist_ok=True)
            (self.path / "sumo").mkdir(exist_ok=True)
            write_atomic(self.path / _PENDING, _json({"identity": self.identity}).encode())
            (self.path / "run.json").unlink(missing_ok=True)
        except OSError as error:
            raise ResultError(f"{self.path}: cannot write the result: {error.strerror or error}") from None

    def _found_identity(self) -> str | None:
        for name in (_PENDING, "run.json"):
            file = self.path / name
            if file.is_file():
                try:
                    content = json.loads(file.read_text())
                    return str(content.get("identity", ""))
                except (ValueError, AttributeError):
                    return ""
        return None

    def _clear(self) -> None:
        """Remove what an earlier run wrote, and nothing else."""
        for name in ("run.json", _PENDING, "seed.csv", "report.html", *_TABLES):
            (self.path / name).unlink(missing_ok=True)
        for pattern in _PATTERNS:
            for file in self.path.glob(pattern):
                file.unlink()
        for name in (_PARTS, "sumo", "baseline"):
            shutil.rmtree(self.path / name, ignore_errors=True)

    def save_part(self, part: Part) -> None:
        """Keep a batch of children until the run is finished."""
        save_part(self.path, part)

    def done(self) -> set[int]:
        """Numbers of the children that need not run again."""
        return {int(c) for (children,) in self._saved("children") for c in children}

    def _saved(self, *names: str) -> Iterator[tuple[NDArray[Any], ...]]:
        """Some arrays of each saved part; the rest, plans above all, stays on the disk."""
        for file in sorted((self.path / _PARTS).glob("*.npz")):
            with np.load(file) as data:
                yield tuple(data[name] for name in names)

    def _read_parts(self) -> list[Part]:
        parts = []
        for file in sorted((self.path / _PARTS).glob("*.npz")):
            with np.load(file) as data:
                states = States(x=data["x"], y=data["y"], heading=data["heading"], speed=data["speed"])
                parts.append(
                    Part(
                        children=data["children"],
                        states=states,
                        values=data["values"],
                        defined=data["defined"],
                        worst=_unpacked(data["worst"]),
                        plan_x=data.get("plan_x"),
                        plan_y=data.get("plan_y"),
                        fallbacks=_unpacked(data["fallbacks"]) if "fallbacks" in data else None,
                        tested=data.get("tested"),
                    )
                )
        return parts

    def values(self, children: int) -> tuple[FloatArray, BoolArray]:
        """(C, 12) metric values of the first children and where they are defined, all of them finished."""
        saved = zip(*self._saved("children", "values", "defined"), strict=True)
        numbers, values, defined = (np.concatenate(parts) for parts in saved)
        _, order = np.unique(numbers, return_index=True)
        order = order[:children]
        return values[order], defined[order]

    def collect(self, children: int) -> Part:
        """All children in order, whatever the batches they ran in.

        Raises:
            ResultError: some are missing.
        """
        parts = self._read_parts()
        numbers = np.concatenate([p.children for p in parts]) if parts else np.empty(0, dtype=np.int64)
        _, order = np.unique(numbers, return_index=True)
        if len(order) != children:
            raise ResultError(
                f"{self.path}: {len(order)} of {children} children are there; run again to resume"
            )
        states = States.concatenate([p.states for p in parts], axis=0)
        return Part(
            children=numbers[order],
            states=states[order],
            values=np.concatenate([p.values for p in parts])[order],
            defined=np.concatenate([p.defined for p in parts])[order],
            worst=_by_child([p.worst for p in parts]),
            plan_x=_joined([p.plan_x for p in parts], order),
            plan_y=_joined([p.plan_y for p in parts], order),
            fallbacks=_in_order([p.fallbacks for p in parts]),
            tested=_joined([p.tested for p in parts], order, axis=1),
        )

    def write_table(self, name: str, table: pa.Table) -> None:
        """Write one of the folder's Parquet files."""
        path = self.path / name
        temporary = path.with_name(f".{name}.writing")
        # Floats in lists hardly repeat: their bytes sorted by significance compress better than a dictionary.
        lists = [field.name for field in table.schema if pa.types.is_fixed_size_list(field.type)]
        try:
            pq.write_table(
                table,
                temporary,
                compression="zstd",
                use_dictionary=[column for column in table.column_names if column not in lists],
                use_byte_stream_split=[f"{column}.list.element" for column in lists] or False,
            )
            temporary.replace(path)
        except OSError as error:
            raise ResultError(f"{path}: cannot write: {error.strerror or error}") from None

    def finish(self, info: Mapping[str, Any]) -> None:
        """Write ``run.json``: from now on the folder is a result."""
        write_atomic(self.path / "run.json", _json({**info, "identity": self.identity}, indent=2).encode())
        (self.path / _PENDING).unlink(missing_ok=True)
        shutil.rmtree(self.path / _PARTS, ignore_errors=True)


_PATTERNS = (
    "densities.*",
    "cumulative.*",
    "scene.png",
    "under_test.*",
    "fallbacks.*",
    "explain*",
    "sample_size*",
)
_TABLES = tuple(
    f"{name}.parquet"
    for name in ("tracks", "plans", "metrics", "assignments", "recorded", "densities", "worst")
)


def _joined(parts: Sequence[FloatArray | None], order: IntArray, axis: int = 0) -> FloatArray | None:
    there = [part for part in parts if part is not None]
    return np.take(np.concatenate(there, axis), order, axis) if there else None


def _by_child(tables: Sequence[pa.Table]) -> pa.Table:
    """Rows ordered by child and metric, whatever the batches that they come from."""
    whole = pa.concat_tables(tables)
    names = np.asarray(whole["metric"])
    return whole.take(np.lexsort((names, np.asarray(whole["child"]))))


def _in_order(tables: Sequence[pa.Table | None]) -> pa.Table | None:
    """Rows ordered by child, whose own rows are in one part; None where no part has any."""
    there = [table for table in tables if table is not None]
    if not there:
        return None
    whole = pa.concat_tables(there)
    return whole.take(np.argsort(np.asarray(whole["child"]), kind="stable"))


def save_part(folder: Path, part: Part) -> None:
    """Keep a batch of children in a result folder until the run is finished."""
    name = f"{int(part.children[0]):08d}-{int(part.children[-1]):08d}.npz"
    target = folder / _PARTS / name
    temporary = target.with_name(f".{name}.writing")
    fallbacks = None if part.fallbacks is None else _packed(part.fallbacks)
    given = {"plan_x": part.plan_x, "plan_y": part.plan_y, "fallbacks": fallbacks, "tested": part.tested}
    some: dict[str, Any] = {name: values for name, values in given.items() if values is not None}
    with temporary.open("wb") as file:
        np.savez(
            file,
            children=part.children,
            x=part.states.x,
            y=part.states.y,
            heading=part.states.heading,
            speed=part.states.speed,
            values=part.values,
            defined=part.defined,
            worst=_packed(part.worst),
            **some,
        )
    temporary.replace(target)


def _unpacked(data: NDArray[np.uint8]) -> pa.Table:
    return pa.ipc.open_stream(data.tobytes()).read_all()


def _packed(table: pa.Table) -> NDArray[np.uint8]:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as stream:
        stream.write_table(table)
    return np.frombuffer(sink.getvalue(), dtype=np.uint8)


def write_atomic(path: Path, content: bytes) -> None:
    """Write a file so that it is there whole or not at all."""
    temporary = path.with_name(f".{path.name}.writing")
    temporary.write_bytes(content)
    temporary.replace(path)


def tracks_table(seed: SeedScene, part: Part) -> pa.Table:
    """Children as INTERACTION cases: frames 1-10 are the seed's history, 10 the seed scene itself.

    Rows are ordered by child, vehicle, frame.
    """
    count, steps, vehicles = part.states.shape
    past = seed.history[:, -LOGGED_HISTORY:]
    frames = LOGGED_HISTORY + steps

    def column(history: FloatArray, simulated: FloatArray) -> FloatArray:
        whole = np.empty((count, vehicles, frames))
        whole[:, :, :LOGGED_HISTORY] = history
        whole[:, :, LOGGED_HISTORY:] = simulated.transpose(0, 2, 1)
        return whole.reshape(-1)

    heading = column(past.heading, part.states.heading)
    speed = column(past.speed, part.states.speed)
    frame = np.tile(np.arange(1, frames + 1, dtype=np.int64), count * vehicles)
    per_vehicle = np.tile(np.repeat(np.arange(vehicles, dtype=np.int32), frames), count)
    types = pa.DictionaryArray.from_arrays(pa.array(per_vehicle), pa.array(list(seed.types), pa.string()))
    return pa.table(
        {
            "case_id": np.repeat(part.children, vehicles * frames),
            "track_id": np.asarray(seed.track_ids)[per_vehicle],
            "frame_id": frame,
            "timestamp_ms": frame * 100,
            "agent_type": types.cast(pa.string()),
            "x": column(past.x, part.states.x),
            "y": column(past.y, part.states.y),
            "vx": speed * np.cos(heading),
            "vy": speed * np.sin(heading),
            "psi_rad": heading,
            "length": seed.length[per_vehicle],
            "width": seed.width[per_vehicle],
        }
    )


def values_table(
    columns: Sequence[str], values: FloatArray, defined: BoolArray, children: IntArray | None = None
) -> pa.Table:
    """Microscopic values, one row per child; null where a metric is undefined.

    Args:
        columns: the names of the metric columns.
        values: (C, len(columns)).
        defined: (C, len(columns)).
        children: (C,) numbers for a leading column ``child``, or None for none.
    """
    data: dict[str, Any] = {} if children is None else {"child": children}
    for index, name in enumerate(columns):
        data[name] = pa.array(values[:, index], mask=~defined[:, index])
    return pa.table(data)


def assignments_table(seed: SeedScene, assignment: IntArray, names: Sequence[str]) -> pa.Table:
    """Which model drove which vehicle: child, track_id, model.

    Args:
        seed: the seed scene.
        assignment: (C, V) index into ``names``.
        names: the models as given, with their parameters.
    """
    count, vehicles = assignment.shape
    models = pa.DictionaryArray.from_arrays(
        pa.array(assignment.reshape(-1)), pa.array(list(names), pa.string())
    )
    return pa.table(
        {
            "child": np.repeat(np.arange(count, dtype=np.int64), vehicles),
            "track_id": np.tile(np.asarray(seed.track_ids), count),
            "model": models.cast(pa.string()),
        }
    )


def _json(content: Mapping[str, Any], indent: int | None = None) -> str:
    return json.dumps(content, sort_keys=indent is None, indent=indent, default=str, allow_nan=False) + "\n"
