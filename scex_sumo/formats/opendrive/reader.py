"""OpenDRIVE maps as roads, with the borders of their lanes."""

from __future__ import annotations

from pathlib import Path

from scex_sumo.base.errors import MapError
from scex_sumo.converters.lanelet.tags import COUNTRIES
from scex_sumo.converters.naming import map_name
from scex_sumo.converters.registries import MapFormat
from scex_sumo.converters.xml import unpacked, xml_root
from scex_sumo.formats.lane_maps.lane_map import drawn_road
from scex_sumo.formats.opendrive.lanes import opendrive_map
from scex_sumo.formats.recognition import is_opendrive
from scex_sumo.formats.samples.boxes import one_line
from scex_sumo.road import Road


def read_opendrive(path: str | Path, **_: object) -> Road:
    """Read an OpenDRIVE file; its coordinates stay the file's."""
    path = Path(path)
    return opendrive_road(path, unpacked(path))


def opendrive_road(path: Path, content: bytes) -> Road:
    """Return the road of an OpenDRIVE text that stands in a file."""
    root = xml_root(path, content, "export the map again")
    signed = next((x.get("country", "").lower() for x in root.iterfind("road/type") if x.get("country")), "")
    country = signed if signed in COUNTRIES else None
    projection = (root.findtext("header/geoReference") or "").strip()
    projection = projection if projection.startswith("+proj") else ""
    with one_line(MapError, path, "road of OpenDRIVE"):
        drawn = opendrive_map(path, root)
        return drawn_road(drawn, name=map_name(path), country=country, projection=projection)


OPENDRIVE = MapFormat(is_mine=is_opendrive, read=read_opendrive, opendrive=unpacked)
