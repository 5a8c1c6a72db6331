"""SUMO net of a road: the files that a conversion leaves, and which SUMO lanes a lanelet became."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from scex_sumo.converters.net.lane_table import LaneTable
from scex_sumo.errors import MapError
from scex_sumo.road import Loss


@dataclass(frozen=True, kw_only=True, eq=False)
class SumoNet:
    """A converted net.

    Attributes:
        path: NET.net.xml.
        extras: NET.add.xml with markings, stop lines, crosswalks and areas for sumo-gui, or None.
        lanes: which SUMO lanes a lanelet became.
        notes: what could not be carried over, one short sentence each, naming ids.
        losses: what of the map is not in the net: the road's losses, and what no net could hold.
    """

    path: Path
    extras: Path | None
    lanes: LaneTable
    notes: tuple[str, ...] = ()
    losses: tuple[Loss, ...] = ()


def open_net(net_path: Path) -> SumoNet:
    """A net that `convert` wrote, with what lies beside it.

    Raises:
        MapError: the net or its lane table is not there.
    """
    table, extras = net_file(net_path, ".lanes.csv"), net_file(net_path, ".add.xml")
    for file in (net_path, table):
        if not file.is_file():
            raise MapError(f"{file}: no such file; convert the map again")
    return SumoNet(path=net_path, extras=extras if extras.is_file() else None, lanes=LaneTable.read(table))


def net_file(net_path: Path, suffix: str) -> Path:
    """The file that belongs to NET.net.xml with another ending: NET + suffix."""
    return net_path.with_name(net_path.name.removesuffix(".xml").removesuffix(".net") + suffix)
