"""Map reading: every registered format, and Lanelet2 itself."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from scex_sumo.base.arguments import checked
from scex_sumo.base.cache import cached_object
from scex_sumo.base.errors import MapError
from scex_sumo.base.version import version_of
from scex_sumo.converters.lanelet.origin import recorded_origin
from scex_sumo.converters.naming import in_memory, other_content, refuse_unreadable
from scex_sumo.converters.registries import MapFormat, map_format, refuse_other_than_map
from scex_sumo.road import Area, Georeference, Lane, MapLoss, Marking, Regulation, Road

MAPS_READ = ".osm, .xml (CommonRoad), .net.xml, .xodr"
_PARTS = (Area, Georeference, Lane, MapLoss, Marking, Regulation, Road)


@checked
def read_map(
    map_path: str | Path,
    *,
    origin: tuple[float, float] | None = None,
    tracks: str | Path | None = None,
    own_corner: bool = True,
    keep: bool = False,
) -> Road:
    """Read a map of any registered format.

    The format is a SUMO net (``.net.xml``), CommonRoad (other ``.xml``), Lanelet2 (``.osm``), OpenDRIVE
    (``.xodr``), OpenStreetMap (an ``.osm`` without lanelets), highD (``NN_recordingMeta.csv``), Argoverse 2
    (``log_map_archive_*.json``), ScenarioNet (``sd_*.pkl``), 123D (``.arrow``) or openDD
    (``map_rdbN.sqlite``).

    Args:
        origin: latitude and longitude in degrees; None looks in the map and beside it.
        tracks: the recording on the map; its ``meta_data.csv`` may give the origin.
        own_corner: whether a map without a known origin begins at its south-west corner.
        keep: use the user's cache of roads.

    Raises `MapError` if the map cannot be read, `MissingExtraError` if a library is not installed.

    Example:
        >>> scex.read_map(scex.example_path("roundabout")).name
        'roundabout'
    """
    path = Path(map_path)
    refuse_unreadable(path)
    read = map_format(path).read
    with in_memory(path):
        road = read(path, origin=origin, tracks=tracks, own_corner=own_corner, keep=keep)
    if not read.__module__.startswith(f"{__package__.partition('.')[0]}."):
        from scex_sumo.roads.check import check_road

        check_road(road, str(path))
    return replace(road, file=path)


def _read_lanelet2(
    path: Path, *, origin: tuple[float, float] | None, tracks: str | Path | None, own_corner: bool, keep: bool
) -> Road:
    refuse_other_than_map(path)
    if kind := other_content(path):
        raise MapError(f"{path}: {kind}, not a map; give {MAPS_READ}")
    known = origin or recorded_origin(path, tracks_path=None if own_corner else tracks)

    def read() -> Road:
        from scex_sumo.converters.lanelet.reader import read_road

        return read_road(path, origin=known, own_corner=own_corner)

    if not (keep and path.is_file() and os.access(path, os.R_OK)):
        return read()
    made_by = repr((version_of("lanelet2"), path.name, known, own_corner))
    return cached_object("roads", made_by.encode() + path.read_bytes(), read, _PARTS)


LANELET2 = MapFormat(is_mine=lambda path: True, read=_read_lanelet2)
