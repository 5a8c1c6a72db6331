"""CommonRoad recordings: scenarios, and consecutive chunks ``SCENE_FIRST_T-LAST`` joined, as MONA's."""

from __future__ import annotations

import itertools
import re
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from scex_sumo.base.errors import TrackError
from scex_sumo.converters.naming import map_name, open_binary
from scex_sumo.converters.registries import Dataset, Recording, recording_name
from scex_sumo.converters.tracks.rows import FLOAT_COLUMNS, TrackRows, TrackTable, track_rows
from scex_sumo.formats.commonroad.file import is_commonroad
from scex_sumo.formats.commonroad.tracks import read_commonroad_tracks, repair_commonroad

_CHUNK = re.compile(r"(?P<scene>.+)_(?P<first>\d+)_T-(?P<last>\d+)")
_SCENE = re.compile(r"(C-)?[A-Z]{3}_[A-Za-z0-9]+-\d+")


def _is_mine(path: Path) -> bool:
    return len(_chains_in(path)) == 1 if path.is_dir() else is_commonroad(path)


def _files(path: Path) -> tuple[Path, ...]:
    return _chains_in(path)[0] if path.is_dir() else (path,)


def _chains_in(folder: Path) -> list[tuple[Path, ...]]:
    return _chains(file for file in folder.iterdir() if is_commonroad(file))


def _read(paths: Sequence[Path], *, net: Path | None = None) -> tuple[TrackTable, tuple[str, ...]]:
    parts = [read_commonroad_tracks(path) for path in paths]
    return parts[0] if len(parts) == 1 else _stitch(parts)


def _recordings(files: Sequence[Path]) -> Iterator[Recording]:
    for paths in _chains(path for path in files if _is_scenario(path)):
        span = _chunk_span(paths[0])
        scene = _SCENE.match(map_name(paths[0]))
        yield Recording(
            name=_name(paths[0], paths),
            site=span[0] if span else scene[0] if scene else map_name(paths[0]),
            dataset="commonroad",
            map_path=paths[0],
            track_paths=paths,
        )


def _name(map_path: Path, files: Sequence[Path]) -> str:
    if len(files) == 1:
        return recording_name(map_path, files)
    end = re.sub(r"^.*[^0-9]", "", map_name(files[-1]))
    return re.sub(r"[0-9]+$", "", map_name(files[0])) + end


def _is_scenario(path: Path) -> bool:
    try:
        with open_binary(path) as file:
            return b"<commonRoad" in file.read(4096)
    except (OSError, EOFError, zlib.error):
        return True


def _siblings(path: Path) -> list[Path]:
    span = _chunk_span(path)
    files = path.parent.iterdir() if span is not None else ()
    return [file for file in files if span is not None and (_chunk_span(file) or ("",))[0] == span[0]]


def _chains(paths: Iterable[Path]) -> list[tuple[Path, ...]]:
    alone: list[tuple[Path, ...]] = []
    chunks = []
    for path in sorted(paths):
        span = _chunk_span(path)
        if span is None:
            alone.append((path,))
        else:
            chunks.append((path.parent, *span, path))
    joined: list[list[Path]] = []
    expected = None
    for folder, scene, first, last, path in sorted(chunks):
        if expected == (folder, scene, first):
            joined[-1].append(path)
        else:
            joined.append([path])
        expected = folder, scene, last + 1
    return alone + [tuple(files) for files in joined]


def _chunk_span(path: Path) -> tuple[str, int, int] | None:
    parts = _CHUNK.fullmatch(map_name(path)) if is_commonroad(path) else None
    if parts is None or int(parts["last"]) <= int(parts["first"]):
        return None
    return parts["scene"], int(parts["first"]), int(parts["last"])


def _stitch(parts: list[tuple[TrackTable, tuple[str, ...]]]) -> tuple[TrackTable, tuple[str, ...]]:
    """Join consecutive chunks to one recording with the clock of the first one."""
    tables = [table for table, _ in parts]
    step_s = tables[0].step_s
    offsets_ms = [0.0]
    for before, table in itertools.pairwise(tables):
        if abs(table.step_s - step_s) > 1e-9:
            raise TrackError(
                f"{table.path}: its time step is {table.step_s:g} s, that of {before.path.name} "
                f"{step_s:g} s; they are no chunks of one recording"
            )
        begin, end = _chunk_span(before.path), _chunk_span(table.path)
        assert begin is not None and end is not None
        offsets_ms.append(1000.0 * step_s * (end[1] - _first_step(tables[0])))
    findings = tuple(f"{table.path.name}: {phrase}" for table, phrases in parts for phrase in phrases)
    vehicles = _joined([table.vehicles for table in tables], offsets_ms)
    others = _joined([table.others for table in tables], offsets_ms)
    return replace(tables[0], path=tables[0].path.parent, vehicles=vehicles, others=others), findings


def _first_step(table: TrackTable) -> int:
    span = _chunk_span(table.path)
    assert span is not None
    return 0 if span[1] == 1 else span[1]


def _joined(parts: list[TrackRows], offsets_ms: list[float]) -> TrackRows:
    labels = sorted({label for part in parts for label in part.labels}, key=lambda label: (len(label), label))
    number = {label: k for k, label in enumerate(labels)}
    kinds = {label: kind for part in parts for label, kind in zip(part.labels, part.types, strict=True)}
    track = np.concatenate(
        [np.array([number[n] for n in part.labels], np.int64)[part.track] for part in parts]
    )
    columns = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in ("frame_id", *FLOAT_COLUMNS)
    }
    columns["timestamp_ms"] += np.repeat(offsets_ms, [len(part) for part in parts])
    order = np.lexsort((columns["timestamp_ms"], track))
    columns = {name: values[order] for name, values in columns.items()}
    return track_rows(track[order], labels, [kinds[label] for label in labels], **columns)


COMMONROAD = Dataset(
    is_mine=_is_mine,
    read=_read,
    recordings=_recordings,
    files=_files,
    name=_name,
    siblings=_siblings,
    repair=repair_commonroad,
)
