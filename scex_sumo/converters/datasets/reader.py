"""Reading and cleaning recordings of every format."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from scex_sumo.converters.cleaning.align import Evidence, align_tracks, evidence
from scex_sumo.converters.cleaning.repair import repair_tracks
from scex_sumo.converters.commonroad.tracks import read_commonroad_tracks, repair_commonroad
from scex_sumo.converters.datasets.levelx import read_levelx
from scex_sumo.converters.formats import all_there, is_commonroad, is_fcd, is_levelx, is_state, map_name
from scex_sumo.converters.moments.sample import resample_tracks
from scex_sumo.converters.moments.scene import Clean
from scex_sumo.converters.sumo.fcd import read_fcd
from scex_sumo.converters.sumo.state import read_state
from scex_sumo.converters.tracks.check import check_values
from scex_sumo.converters.tracks.reader import read_tracks
from scex_sumo.converters.tracks.rows import ROW_COLUMNS, TrackRows, TrackTable, other_rate, segments_of
from scex_sumo.errors import ScexError, TrackError
from scex_sumo.road import Road
from scex_sumo.scene import STEP_S

_CHUNK = re.compile(r"(?P<scene>.+)_(?P<first>\d+)_T-(?P<last>\d+)")


def read_recorded(paths: Sequence[Path], net: Path | None = None) -> tuple[TrackTable, tuple[str, ...]]:
    """Read a recording as it is; nothing is repaired.

    Args:
        paths: one file, or consecutive chunks of one recording in order of time.
        net: the SUMO net of a saved state.

    Returns:
        The recording, and one phrase for what had to be left out, if anything.

    Raises:
        TrackError: it cannot be read, or has a value beyond what it can be.
    """
    table, notes = _read(paths, net)
    check_values(table)
    return table, notes


def _read(paths: Sequence[Path], net: Path | None) -> tuple[TrackTable, tuple[str, ...]]:
    if len(paths) > 1:
        return _stitch([read_commonroad_tracks(path) for path in paths])
    if is_fcd(paths[0]):
        return read_fcd(paths[0])
    if is_state(paths[0]):
        return read_state(paths[0], net)
    if is_commonroad(paths[0]):
        return read_commonroad_tracks(paths[0])
    table = read_levelx(paths[0]) if is_levelx(paths[0]) else read_tracks(paths[0])
    return table, table.notes


def read_clean(paths: Sequence[Path], road: Road | None, *, repair: bool = True, align: bool = True) -> Clean:
    """Read a recording, repair it, bring it to 10 Hz and align it to its map.

    Args:
        paths: one file, or consecutive chunks of one recording in order of time.
        road: the map; without it nothing is aligned.
        repair: whether defects are repaired, see ``repair_tracks``, and other rates than 10 Hz resampled;
            cases of INTERACTION v1.2 are left as they are until one is taken.
        align: whether it is aligned, see ``align_tracks``. Where a file's own evidence is thin, the other
            recordings of its folder, or the other chunks of its scene, are asked.

    Raises:
        TrackError: it cannot be read, or a track is in two places at once.
    """
    table, findings = _repaired(paths, repair=repair, net=None if road is None else road.net)
    if align and road is not None:
        table, moved = align_tracks(table, road, siblings=_siblings(paths))
        findings = (*findings, moved) if moved else findings
    return Clean(table=table, findings=findings, repair=repair)


def _repaired(
    paths: Sequence[Path], *, repair: bool = True, net: Path | None = None
) -> tuple[TrackTable, tuple[str, ...]]:
    table, findings = read_recorded(paths, net)
    if repair and not table.has_cases:
        table, before = repair_commonroad(table) if is_commonroad(paths[0]) else (table, ())
        table, after = repair_tracks(table)
        table = _at_ten_hertz(table)
        findings = (*findings, *before, *after)
    return table, findings


def _at_ten_hertz(table: TrackTable) -> TrackTable:
    if not other_rate(table.step_s):
        return table
    vehicles, others = resample_tracks(table.vehicles), resample_tracks(table.others)
    return replace(table, vehicles=vehicles, others=others, step_s=STEP_S, recorded_step_s=table.step_s)


def _siblings(paths: Sequence[Path]) -> Iterator[tuple[str, Evidence]]:
    """Evidence of the other recordings by the same tracker at the same site; broken ones are passed over."""
    if len(paths) > 1:
        return
    path = paths[0]
    span = chunk_span(path)
    if span is not None:
        files = [file for file in path.parent.iterdir() if (chunk_span(file) or ("",))[0] == span[0]]
    elif path.name.startswith("vehicle_tracks_"):
        files = all_there(path.parent, "vehicle_tracks_*.csv")
    else:
        return
    for file in sorted(files):
        if file.name != path.name:
            with suppress(ScexError):
                yield file.name, _evidence(file, file.stat().st_mtime_ns)


@lru_cache(maxsize=128)
def _evidence(path: Path, _changed_ns: int) -> Evidence:
    """Kept, for the recordings of one folder ask for one another."""
    return evidence(_repaired([path])[0].vehicles)


def chains(paths: Sequence[Path]) -> list[tuple[Path, ...]]:
    """Files grouped into recordings: consecutive chunks together, every other file alone.

    Chunks are CommonRoad files named ``SCENE_FIRST_T-LAST`` of one folder, the next one beginning with the
    step after the last one's end, as MONA's are.
    """
    alone: list[tuple[Path, ...]] = []
    chunks = []
    for path in sorted(paths):
        span = chunk_span(path)
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


def chunk_span(path: Path) -> tuple[str, int, int] | None:
    """Scene, first and last step by a chunk's name; None where it is no chunk's."""
    found = _CHUNK.fullmatch(map_name(path)) if is_commonroad(path) else None
    if found is None or int(found["last"]) <= int(found["first"]):
        return None
    return found["scene"], int(found["first"]), int(found["last"])


def _stitch(parts: list[tuple[TrackTable, tuple[str, ...]]]) -> tuple[TrackTable, tuple[str, ...]]:
    """One recording of consecutive chunks, its clock that of the first one.

    Every chunk's steps begin at 0 again; a road user keeps its id.
    """
    tables = [table for table, _ in parts]
    step_s = tables[0].step_s
    offsets_ms = [0.0]
    for before, table in itertools.pairwise(tables):
        if abs(table.step_s - step_s) > 1e-9:
            raise TrackError(
                f"{table.path}: its time step is {table.step_s:g} s, that of {before.path.name} "
                f"{step_s:g} s; they are no chunks of one recording"
            )
        begin, end = chunk_span(before.path), chunk_span(table.path)
        assert begin is not None and end is not None
        offsets_ms.append(1000.0 * step_s * (end[1] - _zero(tables[0])))
    findings = tuple(f"{table.path.name}: {phrase}" for table, phrases in parts for phrase in phrases)
    return (
        replace(
            tables[0],
            path=tables[0].path.parent,
            vehicles=_joined([table.vehicles for table in tables], offsets_ms),
            others=_joined([table.others for table in tables], offsets_ms),
        ),
        findings,
    )


def _zero(table: TrackTable) -> int:
    """The step, in the chunks' common count, that the first chunk calls 0."""
    span = chunk_span(table.path)
    assert span is not None
    return 0 if span[1] == 1 else span[1]


def _joined(parts: list[TrackRows], offsets_ms: list[float]) -> TrackRows:
    labels = sorted({label for part in parts for label in part.labels}, key=lambda label: (len(label), label))
    number = {label: k for k, label in enumerate(labels)}
    kinds = {label: kind for part in parts for label, kind in zip(part.labels, part.types, strict=True)}
    track = np.concatenate(
        [np.array([number[n] for n in part.labels], np.int64)[part.track] for part in parts]
    )
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in ROW_COLUMNS}
    shift = np.repeat(offsets_ms, [len(part) for part in parts])
    columns["timestamp_ms"] = columns["timestamp_ms"] + shift
    order = np.lexsort((columns["timestamp_ms"], track))
    columns = {name: values[order] for name, values in columns.items()}
    columns["segment"] = segments_of(track[order], columns["timestamp_ms"])
    return TrackRows(
        **columns, track=track[order], labels=tuple(labels), types=tuple(kinds[label] for label in labels)
    )
