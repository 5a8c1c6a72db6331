"""Maps of every format that can be read, told apart by the ending of the file's name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from scex_sumo.converters.formats import OPENDRIVE, is_commonroad, is_highd, is_net
from scex_sumo.converters.sumo.imported import is_open_street_map, read_imported_road
from scex_sumo.road import Road


def read_map(
    map_path: str | Path,
    *,
    origin: tuple[float, float] | None = None,
    tracks: str | Path | None = None,
    own_corner: bool = True,
    country: str | None = None,
) -> Road:
    """Read a map: a SUMO net (``.net.xml``), CommonRoad (other ``.xml``), Lanelet2
    (``.osm``); OpenDRIVE (``.xodr``) and OpenStreetMap (an ``.osm`` without lanelets) by way of netconvert.

    A highD recording has no map: ``NN_recordingMeta.csv`` stands for its straight lanes.

    Args:
        map_path: the map.
        origin: latitude and longitude in degrees where its coordinates begin; None looks for it in the map
            and beside it.
        tracks: the recording that shall lie on the map; its ``meta_data.csv`` may tell the origin.
        own_corner: a Lanelet2 map whose origin is not known begins at its south-west corner; otherwise that
            is an error, for tracks would not lie on it.
        country: whose speed limits hold where a Lanelet2 map gives none; None for that of its tags.

    Raises:
        MapError: the map cannot be read.
        MissingExtraError: it is CommonRoad, and commonroad-io is not installed.
    """
    path = Path(map_path)
    return replace(_read(path, origin, tracks, own_corner=own_corner, country=country), file=path)


def _read(
    path: Path,
    origin: tuple[float, float] | None,
    tracks: str | Path | None,
    *,
    own_corner: bool,
    country: str | None,
) -> Road:
    """The road of a map, by the reader of its format."""
    if str(path).lower().endswith(OPENDRIVE) or is_open_street_map(path):
        return read_imported_road(path)
    if is_net(path):
        from scex_sumo.converters.sumo.net import read_sumo_road

        return read_sumo_road(path)
    if is_commonroad(path):
        from scex_sumo.converters.commonroad.reader import read_commonroad_road

        return read_commonroad_road(path, origin=origin)
    if is_highd(path):
        from scex_sumo.converters.highd_road import read_highd_road

        return read_highd_road(path)
    from scex_sumo.converters.lanelet.reader import read_road

    if not own_corner and path.exists():  # a missing map is the reader's to report
        from scex_sumo.converters.lanelet.origin import find_origin

        origin = find_origin(path, tracks_path=tracks, origin=origin)
    return read_road(path, origin=origin, country=country)
