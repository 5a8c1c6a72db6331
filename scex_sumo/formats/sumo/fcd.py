"""Floating car data (XML, packed or not, or Parquet) of a SUMO simulation as tracks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray
from scex_sumo.base.errors import TrackError
from scex_sumo.converters.naming import open_binary
from scex_sumo.converters.registries import Dataset
from scex_sumo.converters.tracks.check import MAX_VALUES, refuse_values
from scex_sumo.converters.tracks.rows import FLOAT_COLUMNS, TrackTable
from scex_sumo.converters.xml import as_value_error, checked_depth, refuse_declarations
from scex_sumo.formats.damage import refusing_damage
from scex_sumo.formats.recognition import is_fcd
from scex_sumo.formats.samples.build import track_table
from scex_sumo.geometry.polylines import wrap
from scex_sumo.scene import STEP_S

# SUMO's own sizes of its vehicle classes, length and width in m, by a word in the name of the type.
_SIZES = (
    ("pedestrian", (0.215, 0.478)),
    ("truck", (7.1, 2.4)),
    ("trailer", (16.5, 2.55)),
    ("bus", (12.0, 2.5)),
    ("coach", (14.0, 2.6)),
    ("delivery", (6.5, 2.16)),
    ("van", (6.5, 2.16)),
    ("motorcycle", (2.2, 0.9)),
    ("moped", (2.1, 0.8)),
    ("bicycle", (1.6, 0.65)),
    ("bike", (1.6, 0.65)),
    ("tram", (22.0, 2.4)),
)
_CAR = (5.0, 1.8)
_KINDS = {"trailer": "truck", "coach": "bus", "delivery": "van", "moped": "motorcycle", "bike": "bicycle"}
_OTHERS = ("bicycle", "tram", "pedestrian")
_SIZE = ("length", "width")
_COLUMNS = ("time", "x", "y", "angle", "speed", *_SIZE)
_MAX = {"time": MAX_VALUES["timestamp_ms"] / 1000.0, "x": MAX_VALUES["x"], "y": MAX_VALUES["y"]}
_WHAT = "fcd-output of SUMO"
_FILLED_FROM_S = 0.5  # longer steps are filled in here, because straight lines between them cut curves
MIN_STEP_S, MAX_STEP_S = 0.001, 2.0
IN_DEGREES = 1e-3  # of what vehicles drive by their speeds; a metre is 1e-5 degrees

# Of a step in which SUMO changes the lane: sideways, and along beside what the speed says.
ASIDE_M, ALONG_M = (1.2, 6.0), 1.5
LANE_CHANGE_S = 3.0
SLOW_MPS = 3.0  # slower vehicles move sideways without turning so much


def read_fcd(path: str | Path) -> tuple[TrackTable, tuple[str, ...]]:
    """Read SUMO's ``fcd-output``, with a phrase for each guess.

    Unknown sizes are SUMO's own by the type's name. Steps above 0.5 s are filled in to 0.1 s along curves.
    """
    path = Path(path)
    names, kinds, table = _parquet(path) if path.suffix == ".parquet" else _xml(path)
    if not len(table):
        raise TrackError(f"{path}: no vehicle in it; give the fcd-output of a simulation with traffic")
    return tracks_of(path, names, kinds, table)


def tracks_of(
    path: Path, names: Sequence[str], kinds: Sequence[str], table: FloatArray
) -> tuple[TrackTable, tuple[str, ...]]:
    """Build tracks from vehicle states in SUMO's units.

    Args:
        path: the file, for messages.
        names: (N,) of the vehicles.
        kinds: (N,) names of their types.
        table: (N, 7) time, x, y, angle, speed, length, width; nan for unknown sizes.

    Returns:
        The recording, and one phrase for each guess.
    """

    def vehicle_at(row: int) -> str:
        return f"vehicle {names[row]:.24} at {table[row, 0]:g} s"

    refuse_values(path, dict(zip(_COLUMNS, table.T, strict=True)), _MAX, vehicle_at, optional=_SIZE)
    known = dict(map(_word_and_size, kinds))
    of_rows, unknown, findings = [known[kind][0] for kind in kinds], np.isnan(table[:, 5:7]), list[str]()
    if unknown.any():
        table[:, 5:7] = np.where(unknown, [known[kind][1] for kind in kinds], table[:, 5:7])
        findings.append(
            "vehicle sizes are not recorded: SUMO's default sizes are used, by the names of the types"
        )
    labels, track = np.unique(names, return_inverse=True)
    order = np.lexsort((table[:, 0], track))
    track, table = track[order].astype(np.int64), table[order]
    words = np.array(of_rows)[order]
    step, same = np.diff(table, axis=0), np.diff(track) == 0
    moved_m, driven_m = np.hypot(*step[same, 1:3].T).sum(), (step[:, 0] * table[1:, 4])[same].sum()
    if moved_m < IN_DEGREES * driven_m:
        raise TrackError(
            f"{path}: its positions are in degrees; simulate again without --fcd-output.geo, for metres"
        )
    step_s = float(np.median(step[same, 0])) if same.any() else STEP_S
    if not MIN_STEP_S <= step_s <= MAX_STEP_S:
        limits = f"{MIN_STEP_S:g} to {MAX_STEP_S:g} s"
        raise TrackError(f"{path}: simulated in steps of {step_s:g} s, {limits} are read; simulate again")
    if changes := _change_lanes(track, table):
        findings.append(f"{changes} lane changes in one step: drawn over {LANE_CHANGE_S:g} s")
    if step_s > _FILLED_FROM_S:
        track, table, words = _filled(track, table, words, step_s)
        findings.append(f"simulated in steps of {step_s:g} s: filled in to {STEP_S:g} s along curves")
        step_s = STEP_S
    vehicle = ~np.isin(words, _OTHERS)
    numbered = numbers_of([str(label) for label in labels])
    if any(str(number) != str(label) for number, label in zip(numbered, labels, strict=True)):
        findings.append("vehicles are numbered in the order of their names")
    number = np.where(vehicle, track, track + len(labels))  # a person may have the name of a vehicle
    types = dict(zip(number[::-1].tolist(), words[::-1].tolist(), strict=True))  # that of the first row
    of_track = [types.get(k, "") for k in range(2 * len(labels))]
    both = [*map(str, numbered), *map(str, labels)]
    tracks = track_table(path, vehicle, number, both, of_track, step_s=step_s, **_columns(table))
    return tracks, tuple(findings)


def _xml(path: Path) -> tuple[list[str], list[str], FloatArray]:
    names, kinds, rows, time = list[str](), list[str](), list[list[float]](), 0.0
    with refusing_damage(TrackError, path, _WHAT):
        for event, element in xml_elements(path):
            if element.tag == "timestep" and event == "start":
                time = float(element.get("time", "nan"))
            elif event == "end" and element.tag in ("vehicle", "person"):
                names.append(element.get("id", ""))
                kinds.append("pedestrian" if element.tag == "person" else element.get("type", ""))
                rows.append([time, *(float(element.get(column, "nan")) for column in _COLUMNS[1:])])
    return names, kinds, np.array(rows, dtype=np.float64).reshape(-1, len(_COLUMNS))


def xml_elements(path: Path) -> Iterator[tuple[str, Element]]:
    """Yield each element of a file at its ``start`` and ``end``; those below the root are gone after it.

    Raises:
        ValueError, LookupError, OSError, EOFError, zlib.error: it is damaged, or not read.
    """
    above: list[Element] = []
    with as_value_error():
        with open_binary(path) as file:
            refuse_declarations(file)
        with open_binary(path) as file:
            for event, element in ElementTree.iterparse(file, events=("start", "end")):
                if event == "start":
                    above.append(element)
                    checked_depth(len(above))
                yield event, element
                if event == "end":
                    above.pop()
                    if len(above) == 1:
                        above[0].clear()


def _parquet(path: Path) -> tuple[list[str], list[str], FloatArray]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    with refusing_damage(TrackError, path, _WHAT):
        read = pq.read_table(path.absolute())
    columns = {name.removeprefix("timestep_").removeprefix("vehicle_"): name for name in read.column_names}
    missing = [name for name in ("time", "id", "x", "y", "angle", "speed") if name not in columns]
    if missing:
        raise TrackError(f"{path}: no column {missing[0]}; write it with SUMO's --fcd-output FILE.parquet")
    keep = read[columns["id"]].is_valid().to_numpy(zero_copy_only=False)
    read = read.filter(keep)
    table = np.full((read.num_rows, len(_COLUMNS)), np.nan)
    for k, name in enumerate(_COLUMNS):
        if name in columns:
            table[:, k] = read[columns[name]].cast(pa.float64()).to_numpy()
    kinds = read[columns["type"]].to_pylist() if "type" in columns else [""] * read.num_rows
    return [str(n) for n in read[columns["id"]].to_pylist()], [str(k or "") for k in kinds], table


def _word_and_size(kind: str) -> tuple[str, tuple[str, tuple[float, float]]]:
    word, size = next((entry for entry in _SIZES if entry[0] in kind.lower()), ("car", _CAR))
    return kind, (_KINDS.get(word, word), size)


def numbers_of(labels: list[str]) -> list[int]:
    """Return the numbers of vehicles by their distinct names in order: the names, if all are numbers."""
    if all(label.isdecimal() for label in labels):
        return [int(label) for label in labels]
    return list(range(1, len(labels) + 1))


def _filled(
    track: IntArray, table: FloatArray, words: Any, step_s: float
) -> tuple[IntArray, FloatArray, Any]:
    tracks, tables, kinds = [], [], []
    more = round(step_s / STEP_S)
    new = np.flatnonzero((np.diff(track) != 0) | (np.diff(table[:, 0]) > 1.5 * step_s)) + 1
    for first, last in pairwise([0, *new.tolist(), len(track)]):
        run = table[first:last]
        u = np.arange(more) / more
        angle = np.unwrap(np.radians(90.0 - run[:, 3]))
        slope = run[:, 4, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1) * step_s
        t = u[None, :, None]
        p, q, v, w = (x[:, None] for x in (run[:-1, 1:3], run[1:, 1:3], slope[:-1], slope[1:]))
        place = (2 * t**3 - 3 * t**2 + 1) * p + (t**3 - 2 * t**2 + t) * v
        place = place + (3 * t**2 - 2 * t**3) * q + (t**3 - t**2) * w
        time, angle, speed = (
            np.append((column[:-1, None] + u * np.diff(column)[:, None]).ravel(), column[-1])
            for column in (run[:, 0], angle, run[:, 4])
        )
        places = np.vstack([place.reshape(-1, 2), run[-1:, 1:3]])
        sizes = np.broadcast_to(run[0, 5:], (len(time), 2))
        tables.append(np.column_stack([time, places, 90.0 - np.degrees(angle), speed, sizes]))
        tracks.append(np.full(len(time), track[first]))
        kinds.append(np.full(len(time), words[first]))
    return np.concatenate(tracks), np.vstack(tables), np.concatenate(kinds)


def _change_lanes(track: IntArray, table: FloatArray) -> int:
    """Draw the lane changes that SUMO makes in one step over the steps around; return their number."""
    here, there = table[:-1], table[1:]
    elapsed, ahead = there[:, 0] - here[:, 0], np.radians(90.0 - table[:, 3])
    middle = ahead[:-1] + np.asarray(wrap(np.diff(ahead))) / 2
    (dx, dy), c, s = (there - here)[:, 1:3].T, np.cos(middle), np.sin(middle)
    aside, along_m = dy * c - dx * s, dx * c + dy * s
    driven = np.abs(along_m - elapsed * there[:, 4]) < ALONG_M
    lane = (np.abs(aside) > ASIDE_M[0]) & (np.abs(aside) < ASIDE_M[1])
    jumps = np.flatnonzero((np.diff(track) == 0) & (elapsed <= MAX_STEP_S) & driven & lane)
    if not len(jumps):
        return 0
    change_s = table[jumps, 0] + elapsed[jumps] / 2
    begins, ends = np.searchsorted(track, track[jumps]), np.searchsorted(track, track[jumps] + 1)
    halfway = np.where(np.diff(track[jumps]) == 0, (change_s[:-1] + change_s[1:]) / 2, np.nan)
    after = np.fmax(table[begins, 0], np.append(np.nan, halfway)[: len(change_s)])
    before = np.fmin(table[ends - 1, 0], np.append(halfway, np.nan)[: len(change_s)])
    starts = np.maximum(np.minimum(change_s - LANE_CHANGE_S / 2, before - LANE_CHANGE_S), after)
    stops = np.minimum(np.maximum(change_s + LANE_CHANGE_S / 2, after + LANE_CHANGE_S), before)
    for k in range(len(jumps)):
        times = table[begins[k] : ends[k], 0]
        rows = begins[k] + np.flatnonzero((times > starts[k]) & (times < stops[k]))
        u, size = (table[rows, 0] - starts[k]) / (stops[k] - starts[k]), aside[jumps[k]]
        shift = size * (3 * u**2 - 2 * u**3 - (table[rows, 0] > change_s[k]))
        slope = size * 6 * (u - u**2) / (stops[k] - starts[k])
        table[rows, 1] -= shift * np.sin(ahead[rows])
        table[rows, 2] += shift * np.cos(ahead[rows])
        table[rows, 3] -= np.degrees(np.arctan2(slope, np.maximum(table[rows, 4], SLOW_MPS)))
    return len(jumps)


def _columns(table: FloatArray) -> dict[str, Any]:
    # SUMO angles: 0 = north, clockwise; ours: 0 = east, counter-clockwise.
    heading = np.asarray(wrap(np.radians(90.0 - table[:, 3])))
    c, s = np.cos(heading), np.sin(heading)
    # SUMO's position is the front bumper, ours the centre.
    values = (
        1000.0 * table[:, 0],
        table[:, 1] - c * table[:, 5] / 2,
        table[:, 2] - s * table[:, 5] / 2,
        table[:, 4] * c,
        table[:, 4] * s,
        heading,
        table[:, 5],
        table[:, 6],
    )
    return dict(zip(FLOAT_COLUMNS, values, strict=True))


FCD = Dataset(is_mine=is_fcd, read=lambda paths, **_: read_fcd(paths[0]))
