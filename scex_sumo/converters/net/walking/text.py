"""Text of what people walk on, in SUMO's net.xml."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from scex_sumo.converters.net.elements import DECIMALS, NetLane, shape_text
from scex_sumo.converters.net.walking.walks import SPEED_MPS, Walks


def crossing_edges(walks: Walks) -> Iterator[str]:
    """Crossings and walking areas."""
    for crossing in walks.crossings:
        edges = " ".join(crossing.edges)
        yield f'    <edge id="{crossing.name}" function="crossing" crossingEdges="{edges}">'
        yield _lane(crossing.lane)
        yield "    </edge>"
    for name, outline in walks.areas.items():
        yield f'    <edge id="{name}" function="walkingarea">'
        yield (
            f'        <lane id="{name}_0" index="0" allow="pedestrian" speed="{SPEED_MPS}" length="1.00"'
            f' width="2.00" shape="{shape_text(outline)}"/>'
        )
        yield "    </edge>"


def sidewalk_edges(walks: Walks) -> Iterator[str]:
    """Edges to walk on."""
    for walk in walks.sidewalks:
        start, end = walk.nodes
        yield f'    <edge id="{walk.name}" from="{start}" to="{end}" priority="-1" spreadType="center">'
        yield _lane(walk.lane)
        yield "    </edge>"


def junctions_on_foot(walks: Walks) -> Iterator[str]:
    """Junctions that only people use."""
    for name, outline in walks.nodes.items():
        x, y = outline.mean(axis=0)
        yield (
            f'    <junction id="{name}" type="dead_end" x="{x:.{DECIMALS}f}" y="{y:.{DECIMALS}f}"'
            f' incLanes="{" ".join(walks.incoming(name))}" intLanes="" shape="{shape_text(outline)}"/>'
        )


def ways_on_foot(walks: Walks, lights: Mapping[str, tuple[str, int]]) -> Iterator[str]:
    """Connections of crossings, walking areas and sidewalks."""
    for crossing in walks.crossings:
        light = ""
        if crossing.name in lights:
            name, index = lights[crossing.name]
            light = f' tl="{name}" linkIndex="{index}"'
        yield _way(crossing.start, crossing.name, light, state="M" if crossing.marked else "m")
        yield _way(crossing.name, crossing.end)
    for walk in walks.sidewalks:
        start, end = walk.areas
        if start:
            yield _way(start, walk.name)
        if end:
            yield _way(walk.name, end)


def _lane(lane: NetLane) -> str:
    return (
        f'        <lane id="{lane.name}" index="0" allow="{lane.allow}" speed="{lane.speed}"'
        f' length="{max(lane.length, 0.1):.{DECIMALS}f}" width="{lane.width:.2f}"'
        f' shape="{shape_text(lane.shape)}"/>'
    )


def _way(start: str, end: str, light: str = "", state: str = "M") -> str:
    return (
        f'    <connection from="{start}" to="{end}" fromLane="0" toLane="0"{light} dir="s" state="{state}"/>'
    )
