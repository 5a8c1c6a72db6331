"""Traces of ASAM OSI: omega-prime (``.mcap`` with the map inside) and bare traces (``.osi``) beside a map."""

from __future__ import annotations

import errno
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.base.importing import extra_for
from scex_sumo.converters.naming import map_name
from scex_sumo.converters.registries import Dataset, MapFormat, Recording, with_notes
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.converters.xml import unpacked, xml_root
from scex_sumo.formats.damage import MAX_ITEMS, refusing_damage
from scex_sumo.formats.lane_maps.lane_map import FAR_M, DrawnMap, drawn_road
from scex_sumo.formats.opendrive.lanes import opendrive_map, opendrive_road
from scex_sumo.formats.osi_lanes import lanes_of, light_states, osi_map, signals_of
from scex_sumo.formats.recognition import is_opendrive, is_osi
from scex_sumo.formats.samples.boxes import box_table
from scex_sumo.formats.samples.from_car import within_map
from scex_sumo.formats.spat import lane_programme
from scex_sumo.lanelet2sumo.plan.elements import NetLayout, Programme
from scex_sumo.road import Road

TOPICS = {"ground_truth": "GroundTruth", "map": "MapAsamOpenDrive"}
_VEHICLES = {
    7: "truck", 16: "truck", 8: "truck", 6: "truck", 9: "trailer", 10: "motorcycle", 11: "bicycle", 12: "bus",
    13: "tram", 14: "train", 15: "wheelchair", 17: "scooter", 18: "scooter", 19: "work machine",
    20: "watercraft", 21: "aircraft"
}  # fmt: skip
"""Our type by OSI's type of vehicle; every other one is a car."""
_OTHERS = {1: "other", 3: "pedestrian", 4: "animal"}
_UNKNOWN, _VEHICLE = 0, 2
_CUT = "it ends within a record"
MAX_TILT_RAD = 0.5  # of a box that lies on a road
FIRST = 20  # messages, of which one has the map
MAJOR, MAX_BYTES = 3, 2**25  # of OSI's version; of a message: some 500 000 objects


def osi_library() -> Any:
    """Return betterosi; raises `MissingExtraError` where it is not installed."""
    with extra_for("traces of OSI need betterosi", "osi"):
        import betterosi
    return betterosi


@contextmanager
def _damage(error: type[MapError] | type[TrackError], path: Path) -> Iterator[None]:
    from mcap.exceptions import McapError, RecordLengthLimitExceeded

    with refusing_damage(error, path, "trace of OSI"):
        try:
            yield
        except OSError as why:
            if why.errno != errno.EINVAL:  # the reader seeks its summary before the beginning
                raise
            raise ValueError(_CUT) from None
        except RecordLengthLimitExceeded:  # the reader looks for its summary at the end
            raise ValueError(_CUT) from None
        except (McapError, EOFError, struct.error) as why:
            raise ValueError(str(why) or _CUT) from None


def _messages(path: Path, kind: str) -> Iterator[Any]:
    message = getattr(osi_library(), kind)
    for body in _bodies(path, kind):
        if len(body) > MAX_BYTES:
            raise ValueError(f"a message of {len(body) >> 20} MB, more than {MAX_BYTES >> 20}")
        read = message.from_binary(body)
        version = getattr(read, "version", None)
        if version is not None and version.version_major not in (0, MAJOR):
            raise ValueError(f"it is OSI {version.version_major}.{version.version_minor}, not {MAJOR}")
        yield read


def _bodies(path: Path, kind: str) -> Iterator[bytes]:
    if path.suffix == ".osi":
        with path.open("rb") as file:
            while size := file.read(4):
                body = file.read(int.from_bytes(size, "little"))
                if len(size) < 4 or len(body) < int.from_bytes(size, "little"):
                    raise EOFError
                yield body
        return
    from mcap.reader import make_reader

    with path.open("rb") as file:
        for schema, _, record in make_reader(file).iter_messages():
            if schema is not None and schema.name.rpartition(".")[2] == kind:
                yield record.data


def _read_road(path: Path, **_: Any) -> Road:
    """Read the OpenDRIVE map inside a trace, else that beside it, else OSI's lanes."""
    with _damage(MapError, path):
        if (text := _map_text(path)) is not None:
            return opendrive_road(*text)
        drawn = _lane_map(path)
        if not drawn.lanes:
            raise MapError(f"{path}: has no map inside, and no .xodr is beside it; put its map there")
        return drawn_road(drawn, name=map_name(path))


def map_text(path: Path) -> bytes | None:
    """Return the OpenDRIVE text inside a trace, or beside it; None without one."""
    with _damage(MapError, path):
        text = _map_text(path)
        return None if text is None else text[1]


def _map_text(path: Path) -> tuple[Path, bytes] | None:
    if (inside := _opendrive(path)) is not None:
        return path, inside.encode()
    beside = _map_beside(path)
    return None if beside is None else (beside, beside.read_bytes())


def _opendrive(path: Path) -> str | None:
    maps = () if path.suffix == ".osi" else _messages(path, TOPICS["map"])
    return next((message.open_drive_xml_content for message in maps), None)


def _map_beside(path: Path) -> Path | None:
    """Return the OpenDRIVE file of a trace: of its name, else that which it names, else the only one."""
    maps, own = sorted(path.parent.glob("*.xodr")), path.with_suffix(".xodr")
    if own in maps or len(maps) < 2:
        return own if own in maps else next(iter(maps), None)
    named = next((truth.map_reference for truth in _messages(path, TOPICS["ground_truth"])), "")
    return next((file for file in maps if file.name == named), None)


def _lane_map(path: Path) -> DrawnMap:
    truths = islice(_messages(path, TOPICS["ground_truth"]), FIRST)
    return osi_map(path, next((truth for truth in truths if truth.lane), osi_library().GroundTruth()))


def _read(path: Path) -> TrackTable:
    with _damage(TrackError, path):
        names, kinds, values, ego = _boxes(path)
        if np.abs(values[:, 1:3]).max(initial=0.0) > FAR_M and not _opendrive(path) and not _map_beside(path):
            values[:, 1:3] -= _lane_map(path).frame
        return box_table(path, names, kinds, values, ego=ego)


def _read_signals(layout: NetLayout, road: Road, path: Path) -> tuple[Programme | None, list[str]]:
    with _damage(MapError, path):
        truths = _messages(path, TOPICS["ground_truth"])
        if (text := _opendrive_of(road, path)) is None:
            ids = _lane_map(path).lane_ids()
            states = light_states(truths, lanes_of)
            runs = {ids[lane]: run for lane, run in states.items() if lane in ids}
            return lane_programme(layout, road, runs, path.name) if runs else (None, [])
        drawn = opendrive_map(path, xml_root(path, text, "export the map again"))
        ids, shown = drawn.lane_ids(), light_states(truths, signals_of)
        runs = {ids[lane]: shown[signal] for lane, signal in drawn.signals.items() if signal in shown}
        if runs:
            return lane_programme(layout, road, runs, path.name)
        if any(truth.traffic_light for truth in islice(_messages(path, TOPICS["ground_truth"]), FIRST)):
            raise MapError(f"{path.name}: its lights name no signals of the map's lights")
        return None, []


def _opendrive_of(road: Road, path: Path) -> bytes | None:
    """Return the OpenDRIVE text of a road that lies in a file of its own, else that of a trace."""
    if road.file is not None and is_opendrive(road.file):
        return unpacked(road.file)
    return map_text(path)


def _boxes(path: Path) -> tuple[list[str], dict[str, str], FloatArray, str]:
    """Return track and type of each box, (N, 8) values as `box_table` reads them, and the host vehicle.

    OSI's position is the centre of the box; its time is that of the trace.
    """
    names: list[str] = []
    kinds: dict[str, str] = {}
    rows: list[tuple[float, ...]] = []
    ego = ""
    for truth in _messages(path, TOPICS["ground_truth"]):
        time_ms = truth.timestamp.seconds * 1e3 + truth.timestamp.nanos / 1e6
        ego = str(truth.host_vehicle_id.value) if truth.host_vehicle_id is not None else ego
        for moving in truth.moving_object:
            names.append(str(moving.id.value))
            kinds.setdefault(names[-1], _kind(moving))
            rows.append((time_ms, *_state(moving.base)))
        if len(rows) > MAX_ITEMS // 8:
            raise ValueError(f"more than {MAX_ITEMS // 8} boxes in it")
    return names, kinds, np.array(rows, dtype=np.float64).reshape(-1, 8), ego


def _kind(moving: Any) -> str:
    number = int(moving.type)
    if number in _OTHERS:
        return _OTHERS[number]
    known = moving.vehicle_classification
    if number == _UNKNOWN and known is None:
        return "unknown"
    return _VEHICLES.get(int(known.type), "car") if known is not None else "car"


def _state(base: Any) -> tuple[float, ...]:
    """Return x, y, vx, vy, heading, length, width; nan for what is not recorded."""
    place, speed, turn, size = base.position, base.velocity, base.orientation, base.dimension
    if max(abs(turn.roll), abs(turn.pitch)) > MAX_TILT_RAD:
        raise ValueError(f"a box is tilted by {max(abs(turn.roll), abs(turn.pitch)):.1f} rad")
    vx, vy = (speed.x, speed.y) if speed is not None else (np.nan, np.nan)
    length, width = (size.length, size.width) if size is not None else (np.nan, np.nan)
    return place.x, place.y, vx, vy, turn.yaw, length, width


def _recordings(files: Sequence[Path]) -> Iterator[Recording]:
    for path in files:
        with _damage(TrackError, path):
            beside = _map_beside(path) if path.suffix == ".osi" else None
        map_path, name = beside or path, map_name(path)
        site = map_name(map_path)
        yield Recording(name=name, site=site, dataset="osi", map_path=map_path, track_paths=(path,))


OSI_MAP = MapFormat(
    is_mine=is_osi, read=_read_road, tracks=lambda path: path, asks_for="--tracks TRACE", opendrive=map_text
)
OSI = Dataset(
    is_mine=is_osi, read=with_notes(_read), recordings=_recordings, within=within_map, signals=_read_signals
)
