"""Maps of every format that can be read, told apart by the ending of the file's name."""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path

from scex_sumo.converters.formats import OPENDRIVE, is_commonroad, is_highd, is_net
from scex_sumo.converters.sumo.imported import is_open_street_map, read_imported_road
from scex_sumo.kept import kept_object
from scex_sumo.road import Area, Georeference, Lane, Loss, Marking, Regulation, Road
from scex_sumo.version import version_of

_PARTS = (Area, Georeference, Lane, Loss, Marking, Regulation, Road)


def read_map(
    map_path: str | Path,
    *,
    origin: tuple[float, float] | None = None,
    tracks: str | Path | None = None,
    own_corner: bool = True,
    country: str | None = None,
    keep: bool = False,
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
        keep: look for a Lanelet2 map's road in the user's cache, and leave it there.

    Raises:
        MapError: the map cannot be read.
        MissingExtraError: it is CommonRoad, and commonroad-io is not installed.
    """
    path = Path(map_path)
    road = _of_another_format(path, origin)
    if road is None:
        from scex_sumo.converters.lanelet.origin import recorded_origin

        known = origin or recorded_origin(path, tracks_path=None if own_corner else tracks)
        read = partial(_lanelets, path, known, own_corner=own_corner, country=country)
        if keep and path.is_file() and os.access(path, os.R_OK):
            made_by = repr((version_of("lanelet2"), path.name, known, own_corner, country))
            road = kept_object("roads", made_by.encode() + path.read_bytes(), read, _PARTS)
        else:
            road = read()
    return replace(road, file=path)


def _of_another_format(path: Path, origin: tuple[float, float] | None) -> Road | None:
    """The road of a map by the reader of its format; None for a Lanelet2 map."""
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
    return None


def _lanelets(
    path: Path, origin: tuple[float, float] | None, *, own_corner: bool, country: str | None
) -> Road:
    """The road of a Lanelet2 map."""
    from scex_sumo.converters.lanelet.reader import read_road

    if not own_corner and path.exists():  # a missing map is the reader's to report
        from scex_sumo.converters.lanelet.origin import find_origin

        origin = find_origin(path, origin=origin)
    return read_road(path, origin=origin, country=country)
