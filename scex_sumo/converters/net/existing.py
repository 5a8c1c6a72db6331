"""Net that a road was read from, used as it is: copied, with the table of its lanes beside it."""

from __future__ import annotations

from pathlib import Path

from scex_sumo.converters.net.lane_table import LaneTable, read_ends
from scex_sumo.converters.sumo.net import lane_names, unpacked
from scex_sumo.files import write_atomic


def copy_net(source: Path, net_path: Path) -> LaneTable:
    """Copy a net, unpacked; the table of its lanes, which are numbered as those of its road."""
    write_atomic(net_path, unpacked(source))
    return LaneTable(((k + 1, name) for k, name in enumerate(lane_names(source))), read_ends(net_path))
