"""Right of way and lights of a SUMO net, as regulations of a road."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from scex_sumo.road import Regulation

_STOPS = {"allway_stop": "all_way_stop", "priority_stop": "stop"}


def junction_rules(net: Any, numbers: Mapping[str, int]) -> tuple[Regulation, ...]:
    """What the junctions' requests and lights say.

    Args:
        net: as sumolib reads it, with internal lanes and foes.
        numbers: lanes of the road by SUMO's name.
    """
    found: list[Regulation] = []
    for node in net.getNodes():
        for regulation in _of_node(node, numbers, len(found) + 1):
            found.append(regulation)
    return tuple(found)


def _of_node(node: Any, numbers: Mapping[str, int], first: int) -> Iterator[Regulation]:
    """For each link that gives way, to whom; for each light, the lanes that wait at it."""
    links = {node.getLinkIndex(link): link for link in node.getConnections() if _via(link, numbers)}
    links.pop(-1, None)
    number = first
    kind = _STOPS.get(node.getType(), "right_of_way")
    for index, link in sorted(links.items()):
        over = [k for k in sorted(links) if k != index and _yields(node, index, k)]
        if over:
            yield Regulation(
                element_id=number,
                kind=kind,
                lanes=(numbers[link.getFromLane().getID()],),
                yielding=(numbers[_via(link, numbers)],),
                priority=tuple(numbers[_via(links[k], numbers)] for k in over),
            )
            number += 1
    lit = [link for _, link in sorted(links.items()) if link.getTLSID()]
    if lit:
        lanes = dict.fromkeys(numbers[link.getFromLane().getID()] for link in lit)
        yield Regulation(element_id=number, kind="traffic_light", lanes=tuple(lanes), lights=(number,))


def _via(link: Any, numbers: Mapping[str, int]) -> str:
    name = str(link.getViaLaneID())
    return name if name in numbers else ""


def _yields(node: Any, index: int, other: int) -> bool:
    """Whether a link gives way to another, by the request of its junction."""
    response = node._prohibits.get(index, "")
    return other < len(response) and response[-(other + 1)] == "1"
