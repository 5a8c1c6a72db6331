"""Origin of a map: latitude and longitude of its coordinates."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import TypeAlias

from scex_sumo.base.errors import MapError, UsageError
from scex_sumo.converters.naming import map_name, number
from scex_sumo.converters.registries import dataset_of

Place: TypeAlias = tuple[float, float]  # latitude and longitude, degrees

META_DATA = "meta_data.csv"


def recorded_origin(map_path: str | Path, *, tracks_path: str | Path | None = None) -> Place | None:
    """Return the origin in files beside the tracks or the map, latitude and longitude in degrees; None
    without any.

    It is ``xUtmOrigin, yUtmOrigin`` of the tracks' ``recordingMeta.csv`` (inD, rounD, exiD), else
    ``originLat, originLon`` of the ``meta_data.csv`` beside the tracks or the map, or in
    ``recorded_trackfiles/NAME`` beside the map's folder (TAF-BW).
    """
    if tracks_path is not None:
        place = dataset_of(Path(tracks_path)).origin(Path(tracks_path), Path(map_path))
        if place is not None:
            return place
    folder, name = Path(map_path).parent, map_name(map_path)
    folders = [folder, folder / name, folder.parent / "recorded_trackfiles" / name]
    if tracks_path is not None:
        tracks = Path(tracks_path)
        folders.insert(0, tracks if tracks.is_dir() else tracks.parent)
    return next((o for x in folders if (o := _read_meta_data(x / META_DATA)) is not None), None)


def parse_origin(text: str) -> Place:
    """Parse ``--origin LAT,LON`` in degrees, e.g. ``49.0053,8.4374``; raises `UsageError` if invalid."""
    words = text.split(",")
    try:
        lat, lon = (float(word) for word in words)
    except ValueError:
        raise UsageError(
            f"--origin: LAT,LON in degrees expected, e.g. 49.0053,8.4374; got {text!r}"
        ) from None
    if not on_earth(lat, lon):
        raise UsageError(f"--origin: latitude within ±90 and longitude within ±180 expected; got {text!r}")
    return lat, lon


def on_earth(lat: float, lon: float) -> bool:
    """Whether latitude and longitude are a place on Earth."""
    return math.isfinite(lat) and math.isfinite(lon) and abs(lat) <= 90 and abs(lon) <= 180


def _read_meta_data(path: Path) -> Place | None:
    if not path.is_file():
        return None
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            row = next(csv.DictReader(file), None)
    except (OSError, UnicodeError, csv.Error) as error:
        raise MapError(f"{path}: cannot be read ({error}); give --origin LAT,LON") from None
    if row is None or not row.get("originLat") or not row.get("originLon"):
        return None
    lat, lon = number(row["originLat"]), number(row["originLon"])
    if not on_earth(lat, lon):
        got = f"{row['originLat']},{row['originLon']}"
        raise MapError(f"{path}: originLat, originLon is no place on Earth: {got}; give --origin LAT,LON")
    return lat, lon
