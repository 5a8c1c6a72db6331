"""Maps of every format that can be read, told apart by the ending of the file's name."""

from __future__ import annotations

from pathlib import Path

from scex_sumo.converters.formats import OPENDRIVE, is_commonroad, is_highd
from scex_sumo.errors import MapError
from scex_sumo.road import Road


def read_map(
    map_path: str | Path,
    *,
    origin: tuple[float, float] | None = None,
    tracks: str | Path | None = None,
    own_corner: bool = True,
    country: str | None = None,
) -> Road:
    """Read a map: CommonRoad where its name ends in ``.xml`` or ``.xml.gz``, else Lanelet2.

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
        MapError: the map cannot be read, or is OpenDRIVE.
        MissingExtraError: it is CommonRoad, and commonroad-io is not installed.
    """
    path = Path(map_path)
    if str(path).lower().endswith(OPENDRIVE):
        raise MapError(
            f"{path}: OpenDRIVE cannot be read; convert it to CommonRoad (.xml) or Lanelet2 (.osm) first, "
            "e.g. with commonroad-scenario-designer's crdesigner, and look the result over (docs/maps.md)"
        )
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
