"""Copy of the SUMO net of a road that was read from one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from scex_sumo.base.errors import listed
from scex_sumo.converters.net.reading import allowed_content, lane_places, read_ends
from scex_sumo.converters.net.sumo_net import RECORDED, WrittenNet, lane_table
from scex_sumo.converters.net.xml import net_root
from scex_sumo.converters.signals import signal_format
from scex_sumo.lanelet2sumo.drawing import extras_text
from scex_sumo.road import Road


def copy_net(road: Road, signals: Path | None = None) -> WrittenNet:
    """Copy what is allowed of a road's net; lights that ``signals`` tells of show what it recorded."""
    assert road.net is not None
    root = net_root(road.net)
    places = lane_places(root)
    table = lane_table(places, read_ends(root), {lane for _, under in places for lane, _ in under})
    lit = [light.get("id", "") for light in root.iter("tlLogic") if light.find("condition") is not None]
    note = f"traffic lights with conditions: {listed(lit)}; in the futures their phases ignore the conditions"
    content = allowed_content(road.net)[0].decode()
    replay = None if signals is None else signal_format(signals).replay
    if replay is not None and (recorded := replay(root, signals)):
        content = _with_phases(content, recorded)
    return WrittenNet(
        content=content,
        drawing=extras_text(road),
        rows=table.rows,
        ends=table.ends,
        notes=(note,) if lit else (),
    )


def _with_phases(content: str, recorded: Mapping[str, Sequence[tuple[float, str]]]) -> str:
    root = ElementTree.fromstring(content)
    for light in root.iter("tlLogic"):
        name = light.get("id", "")
        if name not in recorded:
            continue
        light.attrib.clear()
        light.attrib.update({"id": name, "type": "static", "programID": RECORDED, "offset": "0"})
        for phase in light.findall("phase"):
            light.remove(phase)
        phases = [("phase", {"duration": f"{s:g}", "state": state}) for s, state in recorded[name]]
        light[:0] = [ElementTree.Element(*phase) for phase in phases]
    return ElementTree.tostring(root, encoding="unicode")
