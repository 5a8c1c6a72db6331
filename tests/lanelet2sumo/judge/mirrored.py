"""Nets and maps with traffic on the left, seen in the mirror: their lanes count from the right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from scex_sumo.converters.net.sumo_net import LaneTable
from scex_sumo.lanelet2sumo.judge.matching import Matching, match_lanelets
from scex_sumo.lanelet2sumo.reader import NetContent, read_net
from scex_sumo.road import Road
from scex_sumo.roads.mirror import mirrored_line, mirrored_road


def read_mirrored(net_path: Path, road: Road) -> tuple[NetContent, Road]:
    """A net in the coordinates of its road, and the road; traffic on the left is seen in the mirror."""
    net = read_net(net_path).in_map(road)
    if not road.left_hand:
        return net, road
    lanes = {i: replace(lane, shape=mirrored_line(lane.shape)) for i, lane in net.lanes.items()}
    return replace(net, lanes=lanes), mirrored_road(road)


def match_mirrored(net_path: Path, road: Road, lanes: LaneTable) -> Matching:
    """The SUMO lanes of a net beside their lanelets."""
    return match_lanelets(*read_mirrored(net_path, road), lanes)
