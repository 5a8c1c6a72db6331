"""Origin of a map's coordinates: the latitude and longitude that its plane is projected with."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from scex_sumo.converters.formats import is_levelx, read_meta, recording_file
from scex_sumo.converters.lanelet.file import MapFile, read_map_file
from scex_sumo.converters.lanelet.projection import to_degrees
from scex_sumo.converters.lanelet.repair import STRAY_M, Place, distance_m, middle
from scex_sumo.errors import MapError, UsageError

META_DATA = "meta_data.csv"
LOCATION_M = 100_000.0  # an origin farther from the recording's own location is a mistake, or in another zone
NEAR_ZERO_M = 50_000.0  # INTERACTION maps lie about 1 km off 0,0 at sea; no real road does


def find_origin(
    map_path: str | Path,
    *,
    tracks_path: str | Path | None = None,
    origin: Place | None = None,
    own_corner: bool = False,
) -> Place:
    """Latitude and longitude, in degrees, that the map is to be projected with.

    The first that is known: ``origin``; ``xUtmOrigin, yUtmOrigin`` of the tracks' ``recordingMeta.csv`` (inD,
    rounD, exiD); ``originLat, originLon`` of the ``meta_data.csv`` beside the tracks
    or beside the map (or in ``recorded_trackfiles/NAME`` next to the map's folder, as TAF-BW has it);
    0, 0 for a map drawn around 0, 0, as INTERACTION's are.

    Args:
        map_path: the map.
        tracks_path: the recording that shall lie on it.
        origin: given by the user.
        own_corner: for a map that no tracks need to match: fall back on its south-west corner instead of
            an error.

    Raises:
        MapError: the origin is not known, or a ``meta_data.csv`` gives one that is none.
    """
    known = origin or recorded_origin(map_path, tracks_path=tracks_path)
    return known or map_origin(read_map_file(map_path), own_corner=own_corner)


def recorded_origin(map_path: str | Path, *, tracks_path: str | Path | None = None) -> Place | None:
    """Place by what a recording says of itself, near the tracks or the map; None where it says nothing.

    Raises:
        MapError: a ``recordingMeta.csv`` or ``meta_data.csv`` gives an origin that is none.
    """
    if tracks_path is not None and is_levelx(tracks_path):
        found = _levelx_origin(recording_file(Path(tracks_path), "recordingMeta"), Path(map_path))
        if found is not None:
            return found
    paths = _meta_data_paths(Path(map_path), Path(tracks_path) if tracks_path is not None else None)
    return next((found for path in paths if (found := _read_meta_data(path)) is not None), None)


def map_origin(map_file: MapFile, *, own_corner: bool) -> Place:
    """Place by the map's own coordinates: 0, 0 where it lies there, else its south-west corner.

    Raises:
        MapError: the map lies elsewhere and ``own_corner`` is False, or it has no nodes.
    """
    centre = middle(map_file)
    if distance_m(centre, (0.0, 0.0)) < NEAR_ZERO_M:
        return 0.0, 0.0
    if own_corner:
        near = [n for n in map_file.nodes.values() if distance_m((n.lat, n.lon), centre) <= STRAY_M]
        return min(n.lat for n in near), min(n.lon for n in near)
    raise MapError(
        f"{map_file.path}: the origin of its coordinates is not known (near {centre[0]:.4f},{centre[1]:.4f}, "
        f"no {META_DATA} with originLat, originLon); give --origin LAT,LON"
    )


def parse_origin(text: str) -> Place:
    """Read ``--origin``: latitude and longitude in degrees, e.g. ``49.0053,8.4374``.

    Raises:
        UsageError: not two numbers, or not a place on Earth.
    """
    parts = text.split(",")
    try:
        lat, lon = (float(part) for part in parts)
    except ValueError:
        raise UsageError(
            f"--origin: LAT,LON in degrees expected, e.g. 49.0053,8.4374; got {text!r}"
        ) from None
    if not _on_earth(lat, lon):
        raise UsageError(f"--origin: latitude within ±90 and longitude within ±180 expected; got {text!r}")
    return lat, lon


def _on_earth(lat: float, lon: float) -> bool:
    return math.isfinite(lat) and math.isfinite(lon) and abs(lat) <= 90 and abs(lon) <= 180


def _meta_data_paths(map_path: Path, tracks_path: Path | None) -> Iterator[Path]:
    if tracks_path is not None:
        folder = tracks_path if tracks_path.is_dir() else tracks_path.parent
        yield folder / META_DATA
    yield map_path.parent / META_DATA
    yield map_path.parent / map_path.stem / META_DATA
    yield map_path.parent.parent / "recorded_trackfiles" / map_path.stem / META_DATA


def _levelx_origin(meta_path: Path, map_path: Path) -> Place | None:
    """Place that a recording's UTM origin is at; the zone is that of its location, else of the map."""
    meta = read_meta(meta_path)
    if not meta.get("xUtmOrigin") or not meta.get("yUtmOrigin"):
        return None
    try:
        east, north = float(meta["xUtmOrigin"]), float(meta["yUtmOrigin"])
        near = float(meta["latLocation"]), float(meta["lonLocation"])
    except KeyError:
        near = middle(read_map_file(map_path))
    except ValueError:
        east, north, near = math.nan, math.nan, (math.nan, math.nan)
    try:
        [place] = to_degrees(np.array([[east, north]]), near, absolute=True)
    except RuntimeError:
        place = np.full(2, math.nan)
    if not _on_earth(*place) or distance_m(place, near) > LOCATION_M:
        got = f"{meta['xUtmOrigin']},{meta['yUtmOrigin']}"
        raise MapError(f"{meta_path}: xUtmOrigin, yUtmOrigin {got} is not near its location; repair the file")
    return float(place[0]), float(place[1])


def _read_meta_data(path: Path) -> Place | None:
    """Place of a recording's meta data, or None where the file or its columns are absent."""
    if not path.is_file():
        return None
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            row = next(csv.DictReader(file), None)
    except (OSError, UnicodeError, csv.Error) as error:
        raise MapError(f"{path}: cannot be read ({error}); give --origin LAT,LON") from None
    if row is None or not row.get("originLat") or not row.get("originLon"):
        return None
    try:
        lat, lon = float(row["originLat"]), float(row["originLon"])
    except ValueError:
        lat, lon = math.nan, math.nan
    if not _on_earth(lat, lon):
        got = f"{row['originLat']},{row['originLon']}"
        raise MapError(f"{path}: originLat, originLon is no place on Earth: {got}; give --origin LAT,LON")
    return lat, lon
