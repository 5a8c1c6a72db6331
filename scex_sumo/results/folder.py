"""Output folder of one process at a time: locked, resumed after an interruption, finished as a result.

That of a run holds its tables, written from finished batches of futures.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Final, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.errors import ResultError
from scex_sumo.base.files import (
    identity_in,
    lock,
    own_folder,
    refuse_special_files,
    remove,
    remove_unfinished,
    replacing,
    unlock,
    write_atomic,
)
from scex_sumo.results.decision import DECISION
from scex_sumo.results.info import BASELINE, PAGE, REFERENCE
from scex_sumo.results.parts import PARTS, Part, Parts, remove_broken
from scex_sumo.results.road import INTENTIONS, ROAD
from scex_sumo.scene import LOGGED_HISTORY, STEP_S, SeedScene, States

PENDING = "incomplete.json"
_COPY = ".incomplete.json"  # used if `PENDING` is damaged
_TABLES = """
    tracks plans metrics assignments recorded densities worst fallbacks collisions encounters pair_outcomes
    under_test horizons conflicts pairs
"""
_Folder = TypeVar("_Folder", bound="OutputFolder")


class OutputFolder:
    """Folder with ``incomplete.json`` while it is written, and the file of its contents once it is finished.

    Both hold the identity by which the same command finds its own folder again.
    """

    info: ClassVar[str]
    """File that makes the folder a result."""
    what: ClassVar[str]
    another: ClassVar[str]
    """Words for the result, and for a result with another configuration."""
    evidence: ClassVar[tuple[str, ...]] = ()
    """Files that together show that a folder is ours if ``info`` is damaged."""
    files: ClassVar[tuple[str, ...]] = ()
    folders: ClassVar[tuple[str, ...]] = ()
    """What it may hold: another result in the same folder removes it."""

    def __init__(self, path: Path, configuration: Mapping[str, Any], *, overwrite: bool = False) -> None:
        """Lock a folder and make it ready to be written; ``overwrite`` replaces another result.

        Raises:
            ResultError: it holds something else, cannot be written, or another process writes it.
        """
        self.path = path
        self.identity = hashlib.sha256(as_json(configuration).encode()).hexdigest()
        try:
            str(path).encode()  # SUMO and Arrow need UTF-8
            path.mkdir(parents=True, exist_ok=True)
            lock(path)
            refuse_special_files(path)
            remove_unfinished(path)
            self._make_free(overwrite)
            for name in (_COPY, PENDING):  # before anything else: what is cut off after it goes on
                write_atomic(path / name, as_json({"identity": self.identity}).encode())
            self._prepare()
            (path / self.info).unlink(missing_ok=True)
        except UnicodeEncodeError:
            raise ResultError(f"{path}: this path is not UTF-8; give another folder with -o") from None
        except OSError as error:
            unlock(path)
            raise ResultError(f"{path}: cannot write the {self.what}: {error.strerror or error}") from None
        except ResultError:
            unlock(path)
            raise

    def _make_free(self, overwrite: bool) -> None:
        """Clear the folder unless it holds the same result; refuse one of another program."""
        names = (PENDING, _COPY, self.info)
        there = [name for name in names if (self.path / name).is_file()]
        identities = [identity for name in there if (identity := identity_in(self.path / name))]
        if self.identity in identities:
            return
        remedy = "give another folder with -o, or --overwrite to replace it"
        if identities:
            if not overwrite:
                raise ResultError(f"{self.path}: holds {self.another}; {remedy}")
        elif there:
            ours = self.evidence and all((self.path / name).exists() for name in self.evidence)
            if not overwrite and not ours:
                raise ResultError(f"{self.path / there[0]}: cannot be read; {remedy}")
        elif any(self.path.iterdir()):
            raise ResultError(
                f"{self.path}: not empty, and no {self.what} of scex-sumo; give another folder with -o"
            )
        self._clear()
        for name in names:
            (self.path / name).unlink(missing_ok=True)

    def _clear(self) -> None:
        """Remove what was written before, and nothing else."""
        self.remove((*self.files, *self.folders))

    def _prepare(self) -> None:
        """Make the folder ready to be written."""
        for name in self.folders:
            own_folder(self.path / name)

    def remove(self, names: Iterable[str]) -> None:
        """Remove files and folders."""
        for name in names:
            remove(self.path / name)

    def finish(self, info: Mapping[str, Any], *, allow_nan: bool = True) -> None:
        """Write the file of the contents: from now on the folder is a result."""
        content = as_json({**info, "identity": self.identity}, indent=2, allow_nan=allow_nan)
        write_atomic(self.path / self.info, content.encode())
        for name in (PENDING, _COPY):
            (self.path / name).unlink(missing_ok=True)

    def close(self) -> None:
        """Unlock the folder."""
        unlock(self.path)

    def __enter__(self: _Folder) -> _Folder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def as_json(content: Mapping[str, Any], *, indent: int | None = None, allow_nan: bool = True) -> str:
    """Return an object as JSON: in one line with sorted keys, or indented."""
    sort = indent is None
    return json.dumps(content, sort_keys=sort, indent=indent, default=str, allow_nan=allow_nan) + "\n"


class ResultFolder(OutputFolder):
    """Folder that a run is written into; a hidden folder in it keeps finished batches."""

    info, what, another = "run.json", "result", "the result of another run"
    evidence = ("metrics.parquet", "assignments.parquet", "tracks.parquet", "seed.csv")
    files = (
        "seed.csv",
        *(ROAD, INTENTIONS, BASELINE, REFERENCE, DECISION, PAGE),
        *(f"{curve}{ending}" for curve in ("density", "cumulative") for ending in (".svg", ".png", ".pdf")),
        *(f"{name}.parquet" for name in _TABLES.split()),
    )
    folders = (PARTS, "sumo")

    def _prepare(self) -> None:
        super()._prepare()
        remove_broken(self.path)

    def in_order(self, futures: int, *, size: int) -> Iterator[Part]:
        """Yield all futures in order, some at a time; raise a `ResultError` if some are missing."""
        parts = Parts(self.path)
        there = int((parts.futures < futures).sum())
        if there != futures:
            raise ResultError(
                f"{self.path}: {there} of {futures} futures are finished; run the same command again"
            )
        for first in range(0, futures, size):
            yield parts.read(first, min(first + size, futures))

    def write_table(self, name: str, table: pa.Table) -> None:
        """Write one of the folder's Parquet files."""
        with self.writer(name) as write:
            write(table)

    @contextlib.contextmanager
    def writer(self, name: str) -> Iterator[Callable[[pa.Table], None]]:
        """Write one of the folder's Parquet files in pieces; without any piece there is no file."""
        file: pq.ParquetWriter | None = None

        def write(table: pa.Table) -> None:
            nonlocal file
            if file is None:
                names = table.schema.names
                file = pq.ParquetWriter(temporary, table.schema, compression="zstd", use_dictionary=names)
            file.write_table(table, row_group_size=max(table.num_rows, 1))  # no future lies in two

        with replacing(self.path / name) as temporary:
            try:
                yield write
            finally:
                if file is not None:
                    file.close()

    def finish(self, info: Mapping[str, Any], *, allow_nan: bool = False) -> None:
        """Write ``run.json``: from now on the folder is a result."""
        super().finish(info, allow_nan=allow_nan)
        shutil.rmtree(self.path / PARTS, ignore_errors=True)
        self.close()


def tracks_table(scene: SeedScene, part: Part) -> pa.Table:
    """Return futures as INTERACTION cases, by future, vehicle, frame; frame 10 is the seed scene.

    States of vehicles that have arrived are null.
    """
    count, steps, vehicles = part.states.shape
    frames, past = LOGGED_HISTORY + steps, scene.history[:, -LOGGED_HISTORY:].repeat(count)
    whole = States.concatenate([past, part.states.swapaxes(1, 2)], axis=2).map(np.ravel)
    motion = {
        "x": whole.x,
        "y": whole.y,
        "vx": whole.speed * np.cos(whole.heading),
        "vy": whole.speed * np.sin(whole.heading),
        "psi_rad": whole.heading,
    }
    frame = np.tile(np.arange(1, frames + 1, dtype=np.int64), count * vehicles)
    per_vehicle = np.tile(np.repeat(np.arange(vehicles, dtype=np.int32), frames), count)
    return pa.table(
        {
            "case_id": np.repeat(part.futures, vehicles * frames),
            "track_id": np.asarray(scene.track_ids)[per_vehicle],
            "frame_id": frame,
            "timestamp_ms": frame * 100,
            "agent_type": pa.array(scene.types, pa.string()).take(pa.array(per_vehicle)),
            **{name: pa.array(values, from_pandas=True) for name, values in motion.items()},  # NaN is null
            "length": scene.length[per_vehicle],
            "width": scene.width[per_vehicle],
        }
    )


def values_table(
    columns: Sequence[str], values: FloatArray, defined: BoolArray, futures: IntArray | None = None
) -> pa.Table:
    """Return metric values (C, columns), one row per future, null where undefined."""
    data: dict[str, Any] = {} if futures is None else {"future": futures}
    for index, name in enumerate(columns):
        data[name] = pa.array(values[:, index], mask=~defined[:, index])
    return pa.table(data)


def assignments_table(scene: SeedScene, assignment: IntArray, names: Sequence[str]) -> pa.Table:
    """Return ``assignments.parquet`` from indices (C, V) into ``names``."""
    count, vehicles = assignment.shape
    return pa.table(
        {
            "future": np.repeat(np.arange(count, dtype=np.int64), vehicles),
            "track_id": np.tile(np.asarray(scene.track_ids), count),
            "model": pa.array(names, pa.string()).take(pa.array(assignment.reshape(-1))),
        }
    )


HORIZONS: Final = "horizons.parquet"
HORIZONS_S: Final = (1.0, 2.0, 3.0, 5.0, 8.0)
FIRST_STEPS: Final = 30


def horizons_of(steps: int) -> tuple[float, ...]:
    """Return the times, s, by which futures of some steps are told, too."""
    return tuple(t for t in HORIZONS_S if t < STEP_S * steps - 1e-9) if steps > FIRST_STEPS else ()
