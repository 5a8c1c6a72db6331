"""An urban intersection without lights: four arms at odd angles, left-turn lanes, give-way on the minor road.

The major road runs from west to east with a left-turn lane on both sides, the minor one from south to north
with a left-turn lane in the south; a zebra crossing lies on the northern arm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from shapely.geometry import Polygon

from example_maps.curves import Curve, Pose, clothoids, smooth_step
from example_maps.drawing import CURB, DASHED, SOLID, VIRTUAL, Lanelet, MapDrawing, Mark, reversed_line

CENTRE = (1000.0, 1000.0)
LANE_M = 3.25
STOP_M = 20.0  # from the centre to the ends of the approaches
STORAGE_M, FORK_M, ARM_M = 30.0, 65.0, 120.0  # along an arm, from there
GIVE_WAY: Mark = ("stop_line", "dashed")
ZEBRA: Mark = ("pedestrian_marking", "")
SMALLEST_CONFLICT_M2 = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class _Arm:
    approaches: list[Lanelet]  # ending at the intersection, left to right in driving direction
    leaving: Lanelet
    others: list[Lanelet]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Movement:
    lanelet: Lanelet
    arm: int
    turn: int  # -1 right, 0 straight, 1 left


def draw() -> MapDrawing:
    """Draw the map around (1000, 1000)."""
    drawing = MapDrawing()
    arms = [  # counter-clockwise from the east; even ones are the major road
        _arm(drawing, 7.0, [(25, 0, 0), (30, 0, 1 / 180), (65, 1 / 180, 1 / 180)], turn_lane=True),
        _arm(drawing, 76.0, [(15, 0, 0), (30, 0, -1 / 90), (45, -1 / 90, -1 / 90), (30, -1 / 90, 0)]),
        _arm(drawing, 181.0, [(35, 0, 0), (30, 0, 1 / 220), (55, 1 / 220, 1 / 220)], turn_lane=True),
        _arm(drawing, 262.0, [(20, 0, 0), (35, 0, 1 / 110), (65, 1 / 110, 1 / 110)], turn_lane=True),
    ]
    movements = _movements(drawing, arms)
    _rules(drawing, arms, movements)
    _crossing(drawing, arms[1])
    drawing.speed_limit([lane for arm in arms[0::2] for lane in arm.others], 50)
    minor = [lane for arm in arms[1::2] for lane in arm.others]
    drawing.speed_limit([*minor, *(m.lanelet for m in movements if m.turn or m.arm % 2)], 30)
    drawing.speed_limit([m.lanelet for m in movements if not m.turn and not m.arm % 2], 50)
    return drawing


def _arm(
    drawing: MapDrawing,
    heading_deg: float,
    shape: list[tuple[float, float, float]],
    *,
    turn_lane: bool = False,
) -> _Arm:
    """Draw an arm outwards; traffic towards the intersection is on the curve's left."""
    heading = float(np.radians(heading_deg))
    start = Pose(x=CENTRE[0], y=CENTRE[1], heading=heading).shifted(STOP_M, 0.0)
    curve = clothoids(start, shape)
    if not turn_lane:
        near = drawing.strip(curve.part(0, STORAGE_M), [LANE_M, 0.0, -LANE_M], [CURB, SOLID, CURB], [-1, 1])
        far = drawing.strip(
            curve.part(STORAGE_M, ARM_M), [LANE_M, 0.0, -LANE_M], [CURB, DASHED, CURB], [-1, 1]
        )
        return _Arm(approaches=[near[0]], leaving=near[1], others=near + far)
    offsets = [LANE_M * k for k in (1.5, 0.5, -0.5, -1.5)]
    near = drawing.strip(curve.part(0, STORAGE_M), offsets, [CURB, SOLID, SOLID, CURB], [-1, -1, 1])
    fork = _fork(drawing, curve.part(STORAGE_M, FORK_M, 1 / 80))
    far = drawing.strip(curve.part(FORK_M, ARM_M), [LANE_M, 0.0, -LANE_M], [CURB, DASHED, CURB], [-1, 1])
    return _Arm(approaches=[near[1], near[0]], leaving=near[2], others=near + fork + far)


def _fork(drawing: MapDrawing, curve: Curve) -> list[Lanelet]:
    """Draw an approach that opens from one lane to two; both directions move apart by half a lane."""
    shift = LANE_M / 2 * (1 - smooth_step(curve.s, 0.0, curve.length))
    outwards = drawing.strip(curve, [-shift, -LANE_M - shift], [SOLID, CURB], [1])
    # The left-turn lane shares the line in the middle with the other direction.
    middle = outwards[0].left
    turning_right = drawing.line(curve.offset(LANE_M - shift), VIRTUAL)
    straight = drawing.strip(curve, [LANE_M + shift, shift], [CURB, VIRTUAL], [-1])
    left, right = reversed_line(middle), reversed_line(turning_right)
    turning = drawing.lanelet(left, right, curvature=(-curve.curvature[-1], -curve.curvature[0]))
    return [*outwards, *straight, turning]


def _movements(drawing: MapDrawing, arms: list[_Arm]) -> list[_Movement]:
    """Draw all twelve movements; the right turns carry the kerbs between the arms."""
    movements = []
    for i, arm in enumerate(arms):
        for turn, other in ((1, 3), (0, 2), (-1, 1)):
            first = arm.approaches[0] if turn == 1 else arm.approaches[-1]
            right = CURB if turn == -1 else VIRTUAL
            lanelet = drawing.connect(first, arms[(i + other) % 4].leaving, VIRTUAL, right)
            movements.append(_Movement(lanelet=lanelet, arm=i, turn=turn))
    return movements


def _rules(drawing: MapDrawing, arms: list[_Arm], movements: list[_Movement]) -> None:
    """Add the rules: the minor road yields to the major one, left turns yield to oncoming traffic."""
    for i in (1, 3):
        lanes = arms[i].approaches
        line = np.stack([lanes[0].left.points[-1], lanes[-1].right.points[-1]])
        stop = drawing.line(line, GIVE_WAY)
        for mine in (m for m in movements if m.arm == i):
            drawing.right_of_way(
                [mine.lanelet], _against(mine, [m for m in movements if m.arm % 2 == 0]), stop
            )
    for mine in (m for m in movements if m.turn == 1):
        oncoming = [m for m in movements if m.arm == (mine.arm + 2) % 4 and m.turn != 1]
        drawing.right_of_way([mine.lanelet], _against(mine, oncoming), None)


def _against(mine: _Movement, others: list[_Movement]) -> list[Lanelet]:
    area = Polygon(mine.lanelet.outline)
    return [
        other.lanelet
        for other in others
        if area.intersection(Polygon(other.lanelet.outline)).area > SMALLEST_CONFLICT_M2
    ]


def _crossing(drawing: MapDrawing, arm: _Arm) -> None:
    """Draw a zebra crossing of 4 m over both lanes of an arm, from pavement to pavement."""
    lane = arm.approaches[0]
    for_pedestrians = {"subtype": "crosswalk", "one_way": "no", "participant:pedestrian": "yes"}
    lines = []
    for distance in (5.0, 9.0):
        at = lane.end.shifted(-distance, 0.0)
        across = Pose(x=at.x, y=at.y, heading=at.heading)
        ends = [across.shifted(0.0, 1.5 * LANE_M + 1.5), across.shifted(0.0, -0.5 * LANE_M - 1.5)]
        lines.append(drawing.line(np.array([(p.x, p.y) for p in ends]), ZEBRA))
    drawing.lanelet(lines[0], lines[1], curvature=(0.0, 0.0), **for_pedestrians)
