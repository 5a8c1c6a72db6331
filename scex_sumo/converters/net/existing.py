"""Net that a road was read from, used as it is: copied, with the table of its lanes beside it."""

from __future__ import annotations

from pathlib import Path

from scex_sumo.converters.net.lane_table import LaneTable, lane_table, read_ends
from scex_sumo.converters.sumo.net import lane_places, open_text
from scex_sumo.files import write_atomic


def copy_net(source: Path, net_path: Path) -> LaneTable:
    """Copy a net, unpacked; the table of its lanes and its road's."""
    write_atomic(net_path, open_text(source))
    places = lane_places(source)
    return lane_table(places, read_ends(net_path), {lane for _, under in places for lane, _ in under})
