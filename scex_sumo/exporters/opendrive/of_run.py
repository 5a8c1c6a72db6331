"""OpenDRIVE of a run: the file that the map came from, else one written from its road."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

from scex_sumo.converters.net.sumo_net import OPENDRIVE, net_file
from scex_sumo.converters.xml import xml_root
from scex_sumo.exporters.light_cycles import with_lights
from scex_sumo.exporters.opendrive.file import OpenDrive, opendrive
from scex_sumo.exporters.request import Request
from scex_sumo.formats.opendrive.lanes import opendrive_map


def opendrive_of(request: Request) -> OpenDrive:
    """Return the map of a run as OpenDRIVE.

    A map that came as OpenDRIVE stays as it is, with its widths and heights. Lights that only the run knows
    join a map that is written.
    """
    given = net_file(request.run.net.path, OPENDRIVE)
    return (
        _as_given(request, given)
        if given.is_file()
        else opendrive(with_lights(request.road, request.run.net))
    )


def _as_given(request: Request, file: Path) -> OpenDrive:
    content = file.read_bytes()
    root = xml_root(file, content)
    offset = root.find("header/offset")
    names = ("x", "y", "z", "hdg")
    x, y, z, heading = (float("0" if offset is None else offset.get(name, "0")) for name in names)
    drawn = opendrive_map(file, root)
    ids = drawn.lane_ids()
    return OpenDrive(
        text=content.decode(errors="replace"),
        projection=(root.findtext("header/geoReference") or "").strip(),
        offset=(x, y, z, heading),
        inside=frozenset(ids[lane.name] for lane in drawn.lanes if lane.inside),
        lights={ids[lane]: (signal, None) for lane, signal in drawn.signals.items()},
        flat=all(_flat(record) for record in root.iter("elevation")),
    )


def _flat(elevation: ET.Element) -> bool:
    return all(float(elevation.get(name, "0")) == 0.0 for name in "abcd")
