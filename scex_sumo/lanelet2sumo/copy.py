"""Copy of the SUMO net of a road that was read from one."""

from __future__ import annotations

from pathlib import Path

from scex_sumo.base.errors import listed
from scex_sumo.converters.net.reading import allowed_content, lane_places, read_ends
from scex_sumo.converters.net.sumo_net import WrittenNet, lane_table
from scex_sumo.converters.xml import net_root
from scex_sumo.lanelet2sumo.drawing import extras_text
from scex_sumo.road import Road


def copy_net(road: Road, signals: Path | None = None) -> WrittenNet:
    """Copy what is allowed of a road's net; its own lights stay."""
    assert road.net is not None
    root = net_root(road.net)
    places = lane_places(root)
    table = lane_table(places, read_ends(root), {lane for _, under in places for lane, _ in under})
    lit = [light.get("id", "") for light in root.iter("tlLogic") if light.find("condition") is not None]
    note = f"traffic lights with conditions: {listed(lit)}; in the futures their phases ignore the conditions"
    content = allowed_content(road.net)[0].decode()
    return WrittenNet(
        content=content,
        drawing=extras_text(road),
        rows=table.rows,
        ends=table.ends,
        notes=(note,) if lit else (),
    )
