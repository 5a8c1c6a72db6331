"""A turbo-like roundabout: four curved arms, splitter islands, two lanes on a third of the ring.

Arm A (south) enters on two lanes, B (east) widens from one to two, C (north) leaves on two, D (west) has one
each way. The outer ring lane begins at A's right entry and ends in C's right exit.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from example_maps.curves import Curve, Pose, arc, clothoids, smooth_step
from example_maps.drawing import CURB, DASHED, SOLID, VIRTUAL, Lanelet, Line, MapDrawing, Mark

CENTRE = (1000.0, 1000.0)
LANE_M = 3.5
RING_LANE_M = 4.5
RING_MIDDLE_M = 20.5  # radius of the line between inner and outer lane
INNER_M = RING_MIDDLE_M + RING_LANE_M * -0.5
OUTER_M = RING_MIDDLE_M + RING_LANE_M * 0.5
GIVE_WAY_M = 31.0  # from the centre to the give-way lines
ISLAND_M, TAPER_M, FORK_M, ARM_M = 20.0, 40.0, 70.0, 125.0  # along an arm, from its give-way line
ISLAND_HALF_WIDTH_M = 1.6
TAPER_BEND = 1 / 80  # of the lines beside the islands, 1/m
GIVE_WAY: Mark = ("stop_line", "dashed")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Arm:
    heading: float
    entries: list[Lanelet]  # lanes that end at the give-way line, left to right in driving direction
    exits: list[Lanelet]  # lanes that begin there, left to right in driving direction
    give_way: Line
    others: list[Lanelet]


def draw() -> MapDrawing:
    """Draw the map around (1000, 1000)."""
    drawing = MapDrawing()
    bend = 1 / 95
    a = _arm(drawing, -93.0, [(25, 0, 0), (25, 0, bend), (45, bend, bend), (35, bend, 0)], entries=2)
    b = _arm(drawing, -14.0, [(30, 0, 0), (30, 0, -1 / 140), (75, -1 / 140, -1 / 140)], fork=True)
    c = _arm(drawing, 84.0, [(30, 0, 0), (40, 0, 1 / 200), (65, 1 / 200, 1 / 200)], exits=2)
    d = _arm(
        drawing, 178.0, [(20, 0, 0), (25, 0, -bend), (30, -bend, -bend), (25, -bend, 0), (35, 0, 1 / 150)]
    )
    inner, outer = _ring(drawing, a, b, c, d)
    crossings = [
        *_enter(drawing, a, [inner[0], outer[0]]),
        *_enter(drawing, b, [inner[2], outer[2]]),
        *_enter(drawing, c, [inner[4]]),
        *_enter(drawing, d, [inner[6]]),
        *_leave(drawing, b, [outer[0]]),
        *_leave(drawing, c, [inner[2], outer[2]]),
        *_leave(drawing, d, [inner[4]]),
        *_leave(drawing, a, [inner[6]]),
    ]
    for arm, priority in ((a, [inner[7]]), (b, [inner[1], outer[1]]), (c, [inner[3]]), (d, [inner[5]])):
        drawing.right_of_way(arm.entries, priority, arm.give_way)
    drawing.speed_limit([*inner, *outer, *crossings], 30)
    drawing.speed_limit([lane for arm in (a, b, c, d) for lane in arm.others], 50)
    return drawing


def _arm(
    drawing: MapDrawing,
    heading_deg: float,
    shape: list[tuple[float, float, float]],
    *,
    entries: int = 1,
    exits: int = 1,
    fork: bool = False,
) -> _Arm:
    """Draw an arm outwards from its give-way line; traffic towards the ring is on the curve's left."""
    heading = float(np.radians(heading_deg))
    start = Pose(x=CENTRE[0], y=CENTRE[1], heading=heading).shifted(GIVE_WAY_M, 0.0)
    curve = clothoids(start, shape)
    near_entries = 2 if fork else entries
    lanes = (near_entries, exits)
    near = _section(drawing, curve.part(0, ISLAND_M, TAPER_BEND), 0.0, lanes, SOLID, CURB)
    taper = _section(drawing, curve.part(ISLAND_M, TAPER_M, TAPER_BEND), ISLAND_M, lanes, DASHED, SOLID)
    far = _far(drawing, curve, entries, exits, fork)
    others = near + taper + far
    if fork:
        others.append(drawing.connect(far[-2], taper[0], VIRTUAL, CURB))
    into, out = near[:near_entries][::-1], near[near_entries:]
    line = np.stack([into[0].left.points[-1], into[-1].right.points[-1]])
    _island(drawing, into[0], out[0])
    return _Arm(
        heading=heading, entries=into, exits=out, give_way=drawing.line(line, GIVE_WAY), others=others
    )


def _far(drawing: MapDrawing, curve: Curve, entries: int, exits: int, fork: bool) -> list[Lanelet]:
    """Draw the sections beyond the taper, outermost last; both directions share the line between them."""
    lanes: list[Lanelet] = []
    ends = [TAPER_M, FORK_M, ARM_M] if fork else [TAPER_M, ARM_M]
    for begin, end in itertools.pairwise(ends):
        offsets = [LANE_M * k for k in range(entries, -exits - 1, -1)]
        edge = VIRTUAL if fork and begin == TAPER_M else CURB
        marks = [edge, *[DASHED] * (entries + exits - 1), CURB]
        lanes += drawing.strip(curve.part(begin, end), offsets, marks, [-1] * entries + [1] * exits)
    return lanes


def _section(
    drawing: MapDrawing, curve: Curve, begin: float, lanes: tuple[int, int], between: Mark, middle: Mark
) -> list[Lanelet]:
    """Draw one section of an arm with an island, or the hatching behind it, between the directions.

    Args:
        curve: of this section, outwards.
        begin: its distance from the give-way line.
        lanes: towards the ring, away from it.
        between: marking between lanes of one direction.
        middle: marking of both sides of the gap.
    """
    gap = ISLAND_HALF_WIDTH_M * (1 - smooth_step(curve.s + begin, 4.0, TAPER_M))
    left = [gap + LANE_M * k for k in range(lanes[0], -1, -1)]
    right = [-gap - LANE_M * k for k in range(lanes[1] + 1)]
    marks = [CURB, *[between] * (lanes[0] - 1), middle, middle, *[between] * (lanes[1] - 1), CURB]
    directions = [-1] * lanes[0] + [0] + [1] * lanes[1]
    return drawing.strip(curve, [*left, *right], marks, directions)


def _island(drawing: MapDrawing, entry: Lanelet, leaving: Lanelet) -> None:
    """Close the splitter island between two lanes with a round nose and a blunt tail."""
    a, b = entry.left.points[-1], leaving.left.points[0]
    turn = np.linspace(0.0, np.pi, 9)[:, None]
    inwards = np.array([np.cos(entry.end.heading), np.sin(entry.end.heading)])
    nose = (a + b) / 2 + np.cos(turn) * (a - b) / 2 + 1.2 * np.sin(turn) * inwards
    tail = np.stack([entry.left.points[0], leaving.left.points[-1]])
    ends = [drawing.line(points, CURB) for points in (nose, tail)]
    drawing.area([entry.left, ends[0], leaving.left, ends[1]], "keepout")


def _merge_angle(arm: _Arm, lanes: list[Lanelet], radii: list[float]) -> float:
    """Return the mean angle between an arm and the place where its lanes reach the ring along an arc.

    An arc's chord turns half as far as the arc.
    """
    angles = []
    for lane, radius in zip(lanes, radii, strict=True):
        pose = lane.end if lane in arm.entries else lane.start
        side = abs(-np.sin(arm.heading) * (pose.x - CENTRE[0]) + np.cos(arm.heading) * (pose.y - CENTRE[1]))

        def miss(angle: float, radius: float = radius, side: float = float(side)) -> float:
            along, across = GIVE_WAY_M - radius * np.cos(angle), radius * np.sin(angle) - side
            return float(np.arctan2(across, along) - (np.pi / 2 - angle) / 2)

        angles.append(brentq(miss, 0.1, 1.5))
    return float(np.mean(angles))


def _ring(drawing: MapDrawing, a: _Arm, b: _Arm, c: _Arm, d: _Arm) -> tuple[list[Lanelet], list[Lanelet]]:
    """Draw the ring, cut where arms meet it: eight inner lanelets from A's entry on, three outer ones."""
    both, single, outside = [INNER_M, OUTER_M], [INNER_M], [OUTER_M]
    cuts = [
        a.heading + _merge_angle(a, a.entries, both),
        b.heading - _merge_angle(b, b.exits, outside),
        b.heading + _merge_angle(b, b.entries, both),
        c.heading - _merge_angle(c, c.exits, both),
        c.heading + _merge_angle(c, c.entries, single),
        d.heading - _merge_angle(d, d.exits, single),
        d.heading + _merge_angle(d, d.entries, single),
        a.heading - _merge_angle(a, a.exits, single) + 2 * np.pi,
        a.heading + _merge_angle(a, a.entries, both) + 2 * np.pi,
    ]
    inner, outer = [], []
    for i, (begin, end) in enumerate(itertools.pairwise(cuts)):
        whole = arc(CENTRE, RING_MIDDLE_M, begin, end)
        edge = DASHED if i % 2 else CURB  # dashed where an arm's traffic crosses it
        if i < 3:
            # No changing lanes right before C's exits, where both lanes leave.
            marks = [CURB, SOLID if i == 2 else DASHED, edge]
            lanes = drawing.strip(
                whole.part(0, whole.length), [RING_LANE_M, 0.0, -RING_LANE_M], marks, [1, 1]
            )
            outer.append(lanes[1])
        else:
            lanes = drawing.strip(whole.part(0, whole.length), [RING_LANE_M, 0.0], [CURB, edge], [1])
        inner.append(lanes[0])
    return inner, outer


def _enter(drawing: MapDrawing, arm: _Arm, ring: list[Lanelet]) -> list[Lanelet]:
    """Draw the lanelets from an arm's give-way line into the ring, from the left."""
    lanes: list[Lanelet] = []
    right: Mark | Line = CURB
    for first, second in list(zip(arm.entries, ring, strict=True))[::-1]:
        lanes.append(drawing.connect(first, second, VIRTUAL, right))
        right = lanes[-1].left
    return lanes[::-1]


def _leave(drawing: MapDrawing, arm: _Arm, ring: list[Lanelet]) -> list[Lanelet]:
    """Draw the lanelets from the ring to an arm, from the left."""
    lanes: list[Lanelet] = []
    right: Mark | Line = CURB
    for first, second in list(zip(ring, arm.exits, strict=True))[::-1]:
        lanes.append(drawing.connect(first, second, VIRTUAL, right))
        right = lanes[-1].left
    return lanes[::-1]
