"""Recorded road users of CommonRoad scenarios as tracks.

Consecutive chunks ``SCENE_FIRST_T-LAST`` are joined, as MONA's.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.base.errors import TrackError
from scex_sumo.converters.lanelet.file import list_ids
from scex_sumo.converters.naming import beginning, map_name
from scex_sumo.converters.registries import Dataset, Recording, recording_name
from scex_sumo.converters.tracks.rows import FLOAT_COLUMNS, FORWARD_MPS, TrackRows, TrackTable
from scex_sumo.formats.commonroad.file import coordinate, element_id, parse_commonroad
from scex_sumo.formats.recognition import (
    chunk_span,
    commonroad_chains,
    is_commonroad,
    is_commonroad_recording,
)
from scex_sumo.formats.samples.build import track_rows, track_table
from scex_sumo.geometry.polylines import wrap

_TYPES = {"priorityVehicle": "vehicle", "unknown": "vehicle", "train": "tram", "parkedVehicle": "parked"}
_MOTOR = {"car", "truck", "bus", "motorcycle", "taxi", "vehicle"}
_BESIDE_THE_ROAD = {"roadBoundary", "building", "medianStrip", "pillar"}
MAX_STEP = 1e6  # a day at 10 Hz
LATE_START_M = 0.1  # a first state this far from its expected position has another time
TURNED_RAD = math.radians(0.3)  # less is within the slip of vehicles
AGREE_RAD = math.radians(0.2)  # half of all headings must be turned by one angle within this

_SCENE = re.compile(r"(C-)?[A-Z]{3}_[A-Za-z0-9]+-\d+")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Track:
    label: int
    kind: str
    motor: bool
    size: tuple[float, float]
    states: FloatArray


def read_commonroad_tracks(path: str | Path) -> tuple[TrackTable, tuple[str, ...]]:
    """Read the obstacles of a CommonRoad scenario; nothing is repaired.

    Static obstacles stand there all the time, except those beside the road. Intervals count as their middle.

    Returns:
        The recording, and a phrase that names unusable obstacles.
    """
    path = Path(path)
    root = parse_commonroad(path)
    step_s = coordinate(root.get("timeStepSize"))
    if not 0.0 < step_s < 10.0:
        raise TrackError(f"{path}: timeStepSize is {root.get('timeStepSize')!r}; a time in seconds expected")
    moving, standing, broken = _tracks(root)
    left_out = (
        f"obstacles without a usable id, shape or states, or twice: {list_ids(broken)}" if broken else ""
    )
    if not moving:
        why = f" ({left_out})" if left_out else ""
        raise TrackError(
            f"{path}: no vehicle with a trajectory in it{why}; give --tracks CSV, or --synthetic N"
        )
    first = min(track.states[0, 0] for track in moving)
    last = max(track.states[-1, 0] for track in moving)
    steps = np.arange(first, last + 1)
    for track in standing:
        states = np.tile(track.states[0], (len(steps), 1))
        states[:, 0], states[:, 4] = steps, 0.0
        moving.append(replace(track, states=states))
    return _table(path, moving, step_s), (f"{left_out}: left out",) if left_out else ()


def repair_commonroad(table: TrackTable) -> tuple[TrackTable, tuple[str, ...]]:
    """Repair two defects of recordings exported to CommonRoad; returns a phrase for each.

    A first position between two steps with the next step's stamp is dropped. Headings that are all turned by
    one angle against the motion are turned back.
    """
    findings = []
    keep = ~_late_starts(table.vehicles)
    if not keep.all():
        dropped = int((~keep).sum())
        table = replace(table, vehicles=table.vehicles.take(keep))
        findings.append(f"first states of {dropped} tracks off their motion: dropped")
    turn = _common_turn(table.vehicles)
    if turn:
        table = replace(table, vehicles=table.vehicles.turned(-turn), others=table.others.turned(-turn))
        findings.append(
            f"headings turned by {math.degrees(turn):.2f} degrees against the motion: turned back"
        )
    return table, tuple(findings)


def _tracks(root: ElementTree.Element) -> tuple[list[_Track], list[_Track], list[int | str]]:
    moving: dict[int, _Track] = {}
    standing: dict[int, _Track] = {}
    broken: list[int | str] = []
    for obstacle, dynamic in _obstacles(root):
        number = element_id(obstacle)
        kind = (obstacle.findtext("type") or "unknown").strip()
        if (not dynamic and kind in _BESIDE_THE_ROAD) or (dynamic and obstacle.find("trajectory") is None):
            continue
        states = _states(obstacle)
        size = _size(obstacle.find("shape"))
        if number is None or size is None or not len(states) or number in moving or number in standing:
            broken.append(number if number is not None else obstacle.get("id", "none"))
            continue
        word = _TYPES.get(kind, kind.lower())
        motor = dynamic and word in _MOTOR
        track = _Track(label=number, kind=word, motor=motor, size=size, states=states)
        (moving if dynamic else standing)[number] = track
    return [moving[i] for i in sorted(moving)], [standing[i] for i in sorted(standing)], broken


def _obstacles(root: ElementTree.Element) -> Iterator[tuple[ElementTree.Element, bool]]:
    for element in root:
        if element.tag in ("dynamicObstacle", "staticObstacle"):
            yield element, element.tag == "dynamicObstacle"
        elif element.tag == "obstacle":
            yield element, (element.findtext("role") or "").strip() == "dynamic"


def _states(obstacle: ElementTree.Element) -> FloatArray:
    elements = [*obstacle.findall("initialState"), *obstacle.findall("trajectory/state")]
    states = [_state(element) for element in elements]
    are_known = np.isfinite([state[:3] for state in states]).all()
    if not states or not are_known or any(abs(state[0]) >= MAX_STEP for state in states):
        return np.empty((0, 5))
    by_time = {state[0]: state for state in reversed(states)}
    return np.array([by_time[time] for time in sorted(by_time)])


def _state(element: ElementTree.Element) -> tuple[float, float, float, float, float]:
    time = _value(element.find("time"))
    point = element.find("position/point")
    x, y = (math.nan, math.nan) if point is None else (coordinate(point.findtext(n)) for n in ("x", "y"))
    return time, x, y, _value(element.find("orientation")), _value(element.find("velocity"))


def _value(element: ElementTree.Element | None) -> float:
    if element is None:
        return math.nan
    if element.find("exact") is not None:
        return coordinate(element.findtext("exact"))
    return (coordinate(element.findtext("intervalStart")) + coordinate(element.findtext("intervalEnd"))) / 2.0


def _size(shape: ElementTree.Element | None) -> tuple[float, float] | None:
    if shape is None:
        return None
    size = (coordinate(shape.findtext("rectangle/length")), coordinate(shape.findtext("rectangle/width")))
    if shape.find("circle") is not None:
        size = (2.0 * coordinate(shape.findtext("circle/radius")),) * 2
    points = [[coordinate(p.findtext(n)) for n in ("x", "y")] for p in shape.findall("polygon/point")]
    if points:
        extent = np.ptp(np.array(points), axis=0)
        size = (float(extent[0]), float(extent[1]))
    return size if all(math.isfinite(side) and side > 0.0 for side in size) else None


def _table(path: Path, tracks: list[_Track], step_s: float) -> TrackTable:
    filled = [_filled(track.states, step_s) for track in tracks]
    counts = [len(states) for states in filled]
    time, x, y, heading, speed = np.concatenate(filled).T
    length, width = np.repeat([track.size for track in tracks], counts, axis=0).T
    return track_table(
        path,
        np.repeat([track.motor for track in tracks], counts),
        np.repeat(np.arange(len(tracks)), counts),
        [str(track.label) for track in tracks],
        [track.kind for track in tracks],
        step_s=step_s,
        frame_id=np.rint(time).astype(np.int64),
        timestamp_ms=1000.0 * step_s * time,
        x=x,
        y=y,
        vx=speed * np.cos(heading),
        vy=speed * np.sin(heading),
        psi_rad=wrap(heading),
        length=length,
        width=width,
    )


def _filled(states: FloatArray, step_s: float) -> FloatArray:
    if len(states) > 1:
        velocity = np.gradient(states[:, 1:3], step_s * states[:, 0], axis=0)
    else:
        velocity = np.zeros((len(states), 2))
    course, speed = np.arctan2(velocity[:, 1], velocity[:, 0]), np.hypot(*velocity.T)
    filled = states.copy()
    filled[:, 3] = np.where(np.isfinite(states[:, 3]), states[:, 3], course)
    filled[:, 4] = np.where(np.isfinite(states[:, 4]), states[:, 4], speed)
    return filled


def _late_starts(rows: TrackRows) -> BoolArray:
    start = np.append(True, np.diff(rows.track) != 0)
    follows = np.append(np.diff(rows.segment) == 0, False)
    driven_m = np.hypot(np.diff(rows.x), np.diff(rows.y))
    said_m = np.diff(rows.timestamp_ms) / 1000.0 * (rows.speed[1:] + rows.speed[:-1]) / 2.0
    return np.asarray(start & follows & np.append(np.abs(driven_m - said_m) > LATE_START_M, False))


def _common_turn(rows: TrackRows) -> float:
    joined = np.diff(rows.segment) == 0
    step = np.stack([np.diff(rows.x), np.diff(rows.y)], axis=1)
    fast = joined & (np.minimum(rows.speed[1:], rows.speed[:-1]) > FORWARD_MPS)
    if fast.sum() < 10:
        return 0.0
    heading = rows.psi_rad[:-1] + wrap(np.diff(rows.psi_rad)) / 2.0
    off = wrap(heading - np.arctan2(step[:, 1], step[:, 0]))[fast]
    turn = float(np.median(off))
    agreed = np.mean(np.abs(off - turn) < AGREE_RAD) >= 0.5
    return turn if agreed and TURNED_RAD < abs(turn) < math.radians(20.0) else 0.0


def _files(path: Path) -> tuple[Path, ...]:
    return commonroad_chains(filter(is_commonroad, path.iterdir()))[0] if path.is_dir() else (path,)


def _read(paths: Sequence[Path], *, net: Path | None = None) -> tuple[TrackTable, tuple[str, ...]]:
    parts = [read_commonroad_tracks(path) for path in paths]
    return parts[0] if len(parts) == 1 else _stitch(parts)


def _recordings(files: Sequence[Path]) -> Iterator[Recording]:
    for paths in commonroad_chains(path for path in files if _is_scenario(path)):
        span = chunk_span(paths[0])
        scene = _SCENE.match(map_name(paths[0]))
        name = _name(paths[0], paths)
        site = span[0] if span else scene[0] if scene else map_name(paths[0])
        yield Recording(name=name, site=site, dataset="commonroad", map_path=paths[0], track_paths=paths)


def _name(map_path: Path, files: Sequence[Path]) -> str:
    if len(files) == 1:
        return recording_name(map_path, files)
    end = re.sub(r"^.*[^0-9]", "", map_name(files[-1]))
    return re.sub(r"[0-9]+$", "", map_name(files[0])) + end


def _is_scenario(path: Path) -> bool:
    start = beginning(path)
    return b"<commonRoad" in start or not start  # what cannot be read is refused when it is loaded


def _siblings(path: Path) -> list[Path]:
    span = chunk_span(path)
    files = filter(is_commonroad, path.parent.iterdir() if span is not None else ())
    return [file for file in files if span is not None and (chunk_span(file) or ("",))[0] == span[0]]


def _stitch(parts: list[tuple[TrackTable, tuple[str, ...]]]) -> tuple[TrackTable, tuple[str, ...]]:
    tables = [table for table, _ in parts]
    step_s = tables[0].step_s
    for before, table in itertools.pairwise(tables):
        if abs(table.step_s - step_s) > 1e-9:
            raise TrackError(
                f"{table.path}: its time step is {table.step_s:g} s, that of {before.path.name} "
                f"{step_s:g} s; they are no chunks of one recording"
            )
    begins = [span[1] for table in tables if (span := chunk_span(table.path))]
    first = 0 if begins[0] == 1 else begins[0]
    offsets_ms = [0.0, *(1000.0 * step_s * (begin - first) for begin in begins[1:])]
    findings = tuple(f"{table.path.name}: {phrase}" for table, phrases in parts for phrase in phrases)
    vehicles = _joined([table.vehicles for table in tables], offsets_ms)
    others = _joined([table.others for table in tables], offsets_ms)
    return replace(tables[0], path=tables[0].path.parent, vehicles=vehicles, others=others), findings


def _joined(chunks: list[TrackRows], offsets_ms: list[float]) -> TrackRows:
    labels = sorted({label for chunk in chunks for label in chunk.labels}, key=lambda text: (len(text), text))
    number = {label: k for k, label in enumerate(labels)}
    kinds = {label: kind for chunk in chunks for label, kind in zip(chunk.labels, chunk.types, strict=True)}
    track = np.concatenate(
        [np.array([number[n] for n in chunk.labels], np.int64)[chunk.track] for chunk in chunks]
    )
    columns = {
        name: np.concatenate([getattr(chunk, name) for chunk in chunks])
        for name in ("frame_id", *FLOAT_COLUMNS)
    }
    columns["timestamp_ms"] += np.repeat(offsets_ms, [len(chunk) for chunk in chunks])
    order = np.lexsort((columns["timestamp_ms"], track))
    columns = {name: values[order] for name, values in columns.items()}
    return track_rows(track[order], labels, [kinds[label] for label in labels], **columns)


COMMONROAD = Dataset(
    is_mine=is_commonroad_recording,
    read=_read,
    recordings=_recordings,
    files=_files,
    name=_name,
    siblings=_siblings,
    repair=repair_commonroad,
)
