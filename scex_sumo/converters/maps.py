"""Maps of every format that can be read, told apart by the ending of the file's name."""

from __future__ import annotations

from pathlib import Path

from scex_sumo.errors import MapError
from scex_sumo.road import Road

COMMONROAD = (".xml", ".xml.gz")
OPENDRIVE = (".xodr", ".xodr.gz")
HIGHD = "_recordingMeta.csv"


def is_commonroad(map_path: str | Path) -> bool:
    """Whether a map is a CommonRoad scenario, by its name."""
    return str(map_path).lower().endswith(COMMONROAD)


def is_highd(map_path: str | Path) -> bool:
    """Whether a file is a highD recording's meta data, whose lane markings are its map, by its name."""
    return str(map_path).endswith(HIGHD)


def map_name(map_path: str | Path) -> str:
    """Name of a map: its file's name without the ending; ``highd_NN`` of a highD recording."""
    if is_highd(map_path):
        return f"highd_{Path(map_path).name.removesuffix(HIGHD)}"
    return Path(Path(map_path).name.removesuffix(".gz")).stem


def read_map(
    map_path: str | Path,
    *,
    origin: tuple[float, float] | None = None,
    tracks: str | Path | None = None,
    own_corner: bool = True,
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
        from scex_sumo.converters.commonroad import read_commonroad_road

        return read_commonroad_road(path, origin=origin)
    if is_highd(path):
        from scex_sumo.converters.recordings_highd import read_highd_road

        return read_highd_road(path)
    from scex_sumo.converters.lanelet import read_road

    if not own_corner and path.exists():  # a missing map is the reader's to report
        from scex_sumo.converters.origin import find_origin

        origin = find_origin(path, tracks_path=tracks, origin=origin)
    return read_road(path, origin=origin)
