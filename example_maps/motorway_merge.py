"""A motorway merge: three lanes in a gentle reverse curve, an on-ramp, and an acceleration lane of 280 m.

The line between the acceleration lane and the right lane is solid for 40 m, then may be crossed from the
acceleration lane only, then from both sides; where the lane ends, a line leads across it.
"""

from __future__ import annotations

import numpy as np

from example_maps.curves import Curve, Pose, clothoids, smooth_step
from example_maps.drawing import DASHED, SOLID, Lanelet, MapDrawing, Mark

LANE_M = 3.75
START = Pose(x=700.0, y=1015.0, heading=-0.12)
SHAPE = [(120.0, 1 / 1400, 1 / 1400), (180.0, 1 / 1400, -1 / 1100), (360.0, -1 / 1100, -1 / 1100)]
RAMP_SHAPE = [(60.0, 0.0, 1 / 220), (40.0, 1 / 220, 1 / 120), (70.0, 1 / 120, 1 / 120), (40.0, 1 / 120, 0.0)]
NOSE_M, OPEN_M, BOTH_M, END_M, CLOSED_M = 200.0, 240.0, 300.0, 480.0, 540.0  # along the carriageway
MOTORWAY_M = 660.0
BARRIER: Mark = ("guard_rail", "")
RAMP_ONLY: Mark = ("line_thin", "solid_dashed")  # dashed on the right: those on the right may cross
MOTORWAY = {"location": "nonurban", "subtype": "highway"}


def draw() -> MapDrawing:
    """Draw the map; traffic runs from about (700, 1015) to the east."""
    drawing = MapDrawing()
    curve = clothoids(START, SHAPE)
    road = [
        *_section(drawing, curve, 0.0, NOSE_M, SOLID),
        *_section(drawing, curve, NOSE_M, OPEN_M, SOLID, accelerating=True),
        *_section(drawing, curve, OPEN_M, BOTH_M, RAMP_ONLY, accelerating=True),
        *_section(drawing, curve, BOTH_M, END_M, DASHED, accelerating=True),
        *_section(drawing, curve, END_M, MOTORWAY_M, SOLID),
    ]
    ramp = _ramp(drawing, road[6])
    closed = curve.part(END_M, CLOSED_M, 1 / 100)
    drawing.line(closed.offset(-4 * LANE_M + LANE_M * smooth_step(closed.s, 0.0, closed.length)), SOLID)
    drawing.speed_limit(road, 120)
    drawing.speed_limit(ramp, 60)
    return drawing


def _section(
    drawing: MapDrawing, curve: Curve, begin: float, end: float, edge: Mark, *, accelerating: bool = False
) -> list[Lanelet]:
    """Draw the lanes of one section from left to right; ``edge`` is the line right of the right lane."""
    lanes = 4 if accelerating else 3
    offsets = [-LANE_M * k for k in range(lanes + 1)]
    marks = [SOLID, DASHED, DASHED, edge, *[SOLID] * accelerating]
    return drawing.strip(curve.part(begin, end), offsets, marks, [1] * lanes, **MOTORWAY)


def _ramp(drawing: MapDrawing, accelerating: Lanelet) -> list[Lanelet]:
    """Draw the ramp backwards from the start of the acceleration lane."""
    end = accelerating.start
    back = clothoids(Pose(x=end.x, y=end.y, heading=end.heading + np.pi), RAMP_SHAPE)
    lanes = []
    for begin, stop in ((0.0, 95.0), (95.0, back.length)):
        lanes += drawing.strip(
            back.part(begin, stop), [LANE_M / 2, -LANE_M / 2], [SOLID, SOLID], [-1], **MOTORWAY
        )
    return lanes
