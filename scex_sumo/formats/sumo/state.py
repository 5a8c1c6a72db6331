"""Saved state of a SUMO simulation as tracks of one moment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from scex_sumo.base.errors import MapError, TrackError
from scex_sumo.converters.naming import beginning
from scex_sumo.converters.net.reader import unpacked
from scex_sumo.converters.registries import Dataset
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.formats.sumo.fcd import tracks_of
from scex_sumo.geometry.polylines import along, length_of

NEAR_M = 0.01  # the direction of a lane is taken over this length


def read_state(path: str | Path, net: Path | None) -> tuple[TrackTable, tuple[str, ...]]:
    """Read the vehicles of a saved state; positions count along the lanes of the simulated net.

    Vehicles that wait to be inserted are left out.
    """
    path = Path(path)
    if net is None:
        raise TrackError(
            f"{path}: a saved state counts along the lanes of its SUMO net; give that as the map"
        )
    try:
        root, roads = (ElementTree.fromstring(unpacked(file)) for file in (path, net))
        time_s = float(root.get("time", "nan"))
        rows = list(_rows(root, roads, time_s))
    except KeyError as error:
        raise TrackError(
            f"{path}: {error.args[0]} is not in {net}; give the net that was simulated"
        ) from None
    except (MapError, ElementTree.ParseError, ValueError, LookupError) as error:
        raise TrackError(f"{path}: cannot be read as a saved state of SUMO: {error}") from None
    if not rows:
        raise TrackError(f"{path}: no vehicle on the road in it; save a state of a simulation with traffic")
    names, kinds, table = zip(*rows, strict=True)
    return tracks_of(path, names, kinds, np.array(table))


def _rows(
    root: ElementTree.Element, roads: ElementTree.Element, time_s: float
) -> Iterator[tuple[str, str, list[float]]]:
    kinds = {kind.get("id", ""): kind for kind in root.iter("vType")}
    vehicles = {vehicle.get("id", ""): vehicle for vehicle in root.iter("vehicle")}
    lanes = {lane.get("id", ""): lane for lane in roads.iter("lane")}
    for lane in root.iter("lane"):
        for on in lane.iter("vehicles"):
            for name in on.get("value", "").split():
                vehicle = vehicles[name]
                kind = kinds.get(vehicle.get("type", ""), ElementTree.Element("vType"))
                angle, speed = (float(vehicle.get(key, "").split()[0]) for key in ("angle", "speed"))
                x, y = _place(lanes[lane.get("id", "")], vehicle)
                sizes = [float(kind.get(key, "nan")) for key in ("length", "width")]
                word = kind.get("vClass", vehicle.get("type", ""))
                yield name, word, [time_s, x, y, angle, speed, *sizes]


def _place(lane: ElementTree.Element, vehicle: ElementTree.Element) -> tuple[float, float]:
    shape = np.array([[float(v) for v in point.split(",")[:2]] for point in lane.get("shape", "").split()])
    at = float(vehicle.get("pos", "").split()[0]) * length_of(shape) / float(lane.get("length", "nan"))
    before, here, after = along(shape, at + np.array([-NEAR_M, 0.0, NEAR_M]))
    ahead = (after - before) / max(float(np.hypot(*(after - before))), 1e-9)
    x, y = here + float(vehicle.get("posLat", "0")) * np.array([-ahead[1], ahead[0]])
    return float(x), float(y)


def is_state(path: Path) -> bool:
    """Whether a file is a saved state of a SUMO simulation, by its beginning."""
    name = str(path).lower()
    xml = name.endswith((".xml", ".xml.gz")) and not name.endswith((".net.xml", ".net.xml.gz"))
    return xml and b"<snapshot" in beginning(path)


def _read(paths: Sequence[Path], *, net: Path | None = None) -> tuple[TrackTable, tuple[str, ...]]:
    return read_state(paths[0], net)


STATE = Dataset(is_mine=is_state, read=_read)
