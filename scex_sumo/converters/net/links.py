"""Links of a SUMO net: connections of lanes of two normal edges, with the internal lanes between."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from xml.etree.ElementTree import Element


@dataclass(frozen=True, kw_only=True, eq=False)
class SumoLink:
    """Connection between lanes of two normal edges.

    Attributes:
        via: internal lanes in driving order, if any.
        junction: empty if no request belongs to it.
        row: its row in the junction's requests, or -1.
        signal: id of its traffic light, or empty.
        signal_index: its place in that light's phases, or -1.
    """

    from_lane: str
    to_lane: str
    via: tuple[str, ...]
    junction: str
    row: int
    state: str
    signal: str
    signal_index: int


def links_of(root: Element) -> Iterator[SumoLink]:
    """Yield the links of a net in the order of the file."""
    rows = {
        lane: (junction.get("id", ""), row)
        for junction in root.iter("junction")
        if junction.get("type") != "internal"
        for row, lane in enumerate(junction.get("intLanes", "").split())
    }
    connections = [(connection, *lane_ids(connection)) for connection in root.iter("connection")]
    # SUMO splits some ways through a junction at an internal one.
    following = {from_lane: connection.get("via", "") for connection, from_lane, _ in connections}
    for connection, from_lane, to_lane in connections:
        if from_lane.startswith(":"):
            continue
        via: list[str] = []
        lane = connection.get("via", "")
        while lane and lane not in via:
            via.append(lane)
            lane = following.get(lane, "")
        junction, row = next((rows[lane] for lane in via if lane in rows), ("", -1))
        yield SumoLink(
            from_lane=from_lane,
            to_lane=to_lane,
            via=tuple(via),
            junction=junction,
            row=row,
            state=connection.get("state", ""),
            signal=connection.get("tl", ""),
            signal_index=int(connection.get("linkIndex", -1)),
        )


def lane_ids(connection: Element) -> tuple[str, str]:
    """Return the ids of the lanes that a connection leads from and to."""
    from_lane = f"{connection.get('from')}_{connection.get('fromLane')}"
    return from_lane, f"{connection.get('to')}_{connection.get('toLane')}"
