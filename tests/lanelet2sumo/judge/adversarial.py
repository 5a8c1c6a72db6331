"""Maps that are awkward on purpose: what further INTERACTION, inD, rounD and SinD maps may hold.

Each map is drawn from gates, cross sections of the road that lanelets share, with smooth curves between them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import cos, pi, radians, sin

import numpy as np

from tests.converters.maps import DASHED, ROAD, SOLID, Lanelet, Line, Point, Relation, rule

WIDE = 3.5


@dataclass
class Drawn:
    """A map, and what is known about it beforehand."""

    lanelets: list[Lanelet] = field(default_factory=list)
    lines: list[Line] = field(default_factory=list)
    relations: list[Relation] = field(default_factory=list)


@dataclass(frozen=True)
class Gate:
    """A cross section: the road's right edge, heading in degrees, widths of the lanes from the right."""

    x: float
    y: float
    heading: float = 0.0
    widths: tuple[float, ...] = (WIDE,)

    def edge(self, index: int) -> tuple[float, float]:
        """Point on the line right of the lane of this index."""
        off = sum(self.widths[:index])
        turned = radians(self.heading)
        return self.x - off * sin(turned), self.y + off * cos(turned)

    def lane(self, first: int, count: int = 1) -> Gate:
        """The part of the gate that some of its lanes take."""
        x, y = self.edge(first)
        return Gate(x, y, self.heading, self.widths[first : first + count])


def centred(x: float, y: float, heading: float = 0.0, width: float = WIDE) -> Gate:
    """A gate of one lane around a point."""
    turned = radians(heading)
    return Gate(x + 0.5 * width * sin(turned), y - 0.5 * width * cos(turned), heading, (width,))


def curve(start: Point, start_deg: float, end: Point, end_deg: float, count: int) -> list[Point]:
    """Points of a cubic between two points with headings; a straight line where both agree."""
    a, b = np.array(start, dtype=float), np.array(end, dtype=float)
    reach = float(np.hypot(*(b - a)))
    da, db = (reach * np.array([cos(radians(d)), sin(radians(d))]) for d in (start_deg, end_deg))
    u = np.linspace(0.0, 1.0, count)[:, None]
    points = (2 * u**3 - 3 * u**2 + 1) * a + (u**3 - 2 * u**2 + u) * da
    points += (3 * u**2 - 2 * u**3) * b + (u**3 - u**2) * db
    return [(float(x), float(y)) for x, y in points]


def row(
    ids: Sequence[int],
    start: Gate,
    end: Gate,
    *,
    between: dict[str, str] = DASHED,
    count: int = 0,
    **more: object,
) -> list[Lanelet]:
    """Lanelets side by side between two gates, ids from right to left, sharing the lines between them."""
    straight = start.heading == end.heading
    points = count or (2 if straight and abs(_sideways(start, end)) < 1e-6 else 15)
    edges = [
        curve(start.edge(k), start.heading, end.edge(k), end.heading, points) for k in range(len(ids) + 1)
    ]
    return [
        Lanelet(
            lanelet_id,
            left=edges[k + 1],
            right=edges[k],
            left_tags=between if k + 1 < len(ids) else SOLID,
            right_tags=between if k else SOLID,
            **more,  # type: ignore[arg-type]
        )
        for k, lanelet_id in enumerate(ids)
    ]


def _sideways(start: Gate, end: Gate) -> float:
    turned = radians(start.heading)
    return -(end.x - start.x) * sin(turned) + (end.y - start.y) * cos(turned)


def chain(first_id: int, gates: Sequence[Gate], **more: object) -> list[Lanelet]:
    """Lanelets of one lane, one after the other."""
    rows = [row([first_id + k], a, b, **more) for k, (a, b) in enumerate(pairwise(gates))]  # type: ignore[arg-type]
    return [lane for lanes in rows for lane in lanes]


def short_lanelets() -> Drawn:
    """Lanelets of half a metre, on the open road, before, inside and after a crossing."""
    xs = [-40, -20, -19.5, -5.5, -5, -0.25, 0.25, 5, 5.5, 20, 20.5, 40]
    ys = [-40, -5, -0.25, 0.25, 5, 40]
    return Drawn(chain(1, [centred(x, 0) for x in xs]) + chain(51, [centred(0, y, 90) for y in ys]))


def lane_opens() -> Drawn:
    """A lane that begins with no width beside another, and one that ends so."""
    one, none, two = (WIDE, 0.0), (WIDE, 0.0), (WIDE, WIDE)
    gates = [
        Gate(0, 0, widths=(WIDE,)),
        Gate(50, 0, widths=none),
        Gate(90, 0, widths=two),
        Gate(150, 0, widths=two),
        Gate(190, 0, widths=one),
        Gate(240, 0, widths=(WIDE,)),
    ]
    lanes = row([1], gates[0], gates[1].lane(0))
    for number, (a, b) in enumerate(pairwise(gates[1:5])):
        lanes += row([10 * number + 11, 10 * number + 12], a, b)
    return Drawn(lanes + row([2], gates[4].lane(0), gates[5]))


def kinks() -> Drawn:
    """A lane that turns on the spot by 30, 60 and 89 degrees between short lanelets."""
    x, y, heading, gates = 0.0, 0.0, 0.0, [centred(0.0, 0.0)]
    for turn, length in ((0, 30), (30, 15), (60, 8), (0, 20), (-89, 8), (0, 30)):
        # The gate halves the angle, as drawn maps do; the bounds then kink where they meet.
        heading += turn
        x, y = x + length * cos(radians(heading)), y + length * sin(radians(heading))
        gates.append(centred(x, y, heading))
    lanes = [
        Lanelet(1 + k, left=[a.edge(1), b.edge(1)], right=[a.edge(0), b.edge(0)])
        for k, (a, b) in enumerate(pairwise(gates))
    ]
    return Drawn(lanes)


def border_fork() -> Drawn:
    """Three lanelets that leave one gate at the map's border, right in the way of crossing traffic."""
    gate = centred(-10, 0)
    lanes = row([1], gate, centred(40, 0)) + row([2], gate, centred(8, 25, 90))
    lanes += row([3], gate, centred(8, -25, -90))
    lanes += chain(11, [centred(0, y, 90) for y in (-40, -20, 20, 40)])
    return Drawn(lanes)


def starts_inside() -> Drawn:
    """A lanelet that begins in the middle of an intersection, and one that ends there."""
    lanes = chain(1, [centred(x, 0) for x in (-40, -10, 10, 40)])
    lanes += chain(11, [centred(0, y, 90) for y in (-1, 15, 40)])
    return Drawn(lanes + chain(21, [centred(4, y, 90) for y in (-40, -15, 1)]))


def two_steps_apart() -> Drawn:
    """A fork whose second branch is cut in two before it has left the first."""
    stem, half, gone = centred(0, 0), centred(12, 0.8, 8), centred(45, 14, 20)
    lanes = row([1], centred(-40, 0), stem) + row([2], stem, centred(60, 0))
    return Drawn(lanes + row([3], stem, half, count=15) + row([4], half, gone))


def both_ways() -> Drawn:
    """One lanelet for both directions between two one-way ends, and a road with opposing traffic."""
    two_way = {**ROAD, "one_way": "no"}
    one, two, three, four = (centred(x, 0) for x in (-60, -20, 20, 60))
    lanes = row([1], one, two) + row([2], two, three, tags=two_way) + row([3], three, four)
    lanes += row([4], centred(-60, 20), centred(60, 20))
    return Drawn(lanes + row([5], centred(60, 23.5, 180), centred(-60, 23.5, 180)))


def same_ground_both_ways() -> Drawn:
    """Two lanelets on the same ground against each other, as narrow streets are drawn."""
    lanes = chain(1, [centred(x, 0) for x in (-60, -20, 20, 60)])
    return Drawn(lanes + chain(11, [centred(x, 0, 180) for x in (60, 20, -20, -60)]))


def ring(parts: int, arms: int, radius: float = 15.0) -> Drawn:
    """A roundabout of some lanelets, with an entry and an exit per arm; one part is a loop onto itself."""
    step = 360.0 / parts

    def at(angle: float) -> Gate:
        return centred(radius * cos(radians(angle)), radius * sin(radians(angle)), angle + 90)

    lanes = []
    for part in range(parts):
        angles = np.linspace(part * step, (part + 1) * step, 2 + int(40 / parts))
        gates = [at(float(angle) % 360.0) for angle in angles]
        lanes.append(Lanelet(part + 1, left=[g.edge(1) for g in gates], right=[g.edge(0) for g in gates]))
    for arm in range(arms):
        angle = arm * 360.0 / arms
        inward, outward = angle - 12.0, angle + 12.0
        far = 50.0
        into = centred(far * cos(radians(inward)), far * sin(radians(inward)), angle + 180)
        away = centred(far * cos(radians(outward)), far * sin(radians(outward)), angle)
        lanes += row([100 + arm], into, at(angle)) + row([200 + arm], at(angle), away)
    return Drawn(lanes)


def loop_of_one() -> Drawn:
    """A roundabout of one lanelet that is its own successor."""
    return ring(1, 1)


def roundabout_of_four() -> Drawn:
    """An ordinary small roundabout without rules."""
    return ring(4, 4)


def partners_across_a_crossing() -> Drawn:
    """Two lanes with lane changes everywhere, crossed by a road in the middle."""
    two = (WIDE, WIDE)
    gates = [Gate(x, 0, widths=two) for x in (-60, -8, 8, 60)]
    lanes = []
    for number, (a, b) in enumerate(pairwise(gates)):
        lanes += row([10 * number + 1, 10 * number + 2], a, b)
    return Drawn(lanes + chain(51, [centred(0, y, 90) for y in (-40, -6, 12, 40)]))


def ends_together() -> Drawn:
    """Three lanelets that merge at the map's border, with nothing behind."""
    gate = centred(0, 0)
    lanes = row([1], centred(-50, 0), gate)
    return Drawn(lanes + row([2], centred(-45, -20, 25), gate) + row([3], centred(-45, 20, -25), gate))


def u_turn() -> Drawn:
    """Opposing lanes with a U-turn between them, beside the straight ahead."""
    there = [centred(x, 0) for x in (-50, 0, 50)]
    back = [centred(x, 8, 180) for x in (50, 0, -50)]
    return Drawn(chain(1, there) + chain(11, back) + row([21], there[1], back[1]))


def intersection(*, lanes: int = 1, arms: int = 4) -> Drawn:
    """An intersection with every turn; lanelet 100 comes in on the first arm, 150 goes out, 10100 turns."""
    widths, box, far = (WIDE,) * lanes, 16.0, 60.0
    drawn: list[Lanelet] = []
    into, away = {}, {}
    for arm in range(arms):
        angle = 360.0 * arm / arms
        ahead = np.array([cos(radians(angle)), sin(radians(angle))])
        left = np.array([-ahead[1], ahead[0]])

        def gate(distance: float, side: float, heading: float, ahead=ahead, left=left) -> Gate:  # type: ignore[no-untyped-def]
            return Gate(*(float(v) for v in distance * ahead + side * left), heading, widths)

        wide = lanes * WIDE
        # Right-hand traffic: seen from the centre, lanes out lie on the right, lanes in on the left.
        into[arm] = gate(box, wide, angle + 180.0)
        away[arm] = gate(box, -wide, angle)
        numbers = [100 * arm + 100 + k for k in range(lanes)]
        drawn += row(numbers, gate(far, wide, angle + 180.0), into[arm])
        drawn += row([n + 50 for n in numbers], away[arm], gate(far, -wide, angle))
    for arm in range(arms):
        for other in range(arms):
            if other != arm:
                turn = (other - arm) % arms
                used = [0] if turn == 1 else [lanes - 1] if turn == arms - 1 else range(lanes)
                for k in used:
                    number = 10000 + 1000 * arm + 100 * other + k
                    drawn += row([number], into[arm].lane(k), away[other].lane(k))
    return Drawn(drawn)


def wide_intersection() -> Drawn:
    """Four arms of two lanes with lane changes before and behind, no rules."""
    return intersection(lanes=2)


def five_arms() -> Drawn:
    """Five arms at 72 degrees."""
    return intersection(arms=5)


def _with_rule(lane: Lanelet, number: int) -> Lanelet:
    return replace(lane, rules=(*lane.rules, number))


def neighbouring_crossings() -> Drawn:
    """Two crossings one metre apart, with conflict-free lanelets between them."""
    lanes = chain(1, [centred(x, 0) for x in (-50, -3, 3, 4, 10, 50)])
    lanes += chain(11, [centred(0, y, 90) for y in (-40, -3, 3, 40)])
    return Drawn(lanes + chain(21, [centred(7, y, 270) for y in (40, 3, -3, -40)]))


def spiral() -> Drawn:
    """A ramp that crosses over its own start."""
    angles = np.linspace(0.0, 1.4 * 2 * pi, 60)
    radii = 25.0 - 6.0 * angles / (2 * pi)

    def bound(off: float) -> list[tuple[float, float]]:
        xs, ys = (radii + off) * np.cos(angles), (radii + off) * np.sin(angles)
        start = [(round(float(xs[0]), 4), round(float(ys[0]) - 40.0, 4))]
        way = [(round(float(x), 4), round(float(y), 4)) for x, y in zip(xs, ys, strict=True)]
        exit_x, exit_y = way[-1]
        heading = angles[-1] + pi / 2
        return [*start, *way, (round(exit_x + 60 * cos(heading), 4), round(exit_y + 60 * sin(heading), 4))]

    return Drawn([Lanelet(1, left=bound(-0.5 * WIDE), right=bound(0.5 * WIDE))])


def bridge() -> Drawn:
    """A road six metres above another."""

    def raised(points: Sequence[Point]) -> list[Point]:
        return [(*point[:2], 6.0) for point in points]

    below = chain(1, [centred(x, 0) for x in (-50, -10, 10, 50)])
    above = chain(11, [centred(0, y, 90) for y in (-50, -10, 10, 50)])
    return Drawn(below + [replace(lane, left=raised(lane.left), right=raised(lane.right)) for lane in above])


def roundabout_of_two_lanes() -> Drawn:
    """A ring of two lanes with lane changes between them; entries and exits of one lane at four arms."""
    inner, parts, lanes = 14.0, 8, []

    def at(angle: float) -> Gate:
        # Driven counter-clockwise: the outer lane lies on the right.
        outer = inner + 2 * WIDE
        return Gate(outer * cos(radians(angle)), outer * sin(radians(angle)), angle + 90, (WIDE, WIDE))

    for part in range(parts):
        angles = [45.0 * part + 45.0 / 6 * k for k in range(7)]
        gates = [at(angle % 360.0) for angle in angles]
        edges = [[gate.edge(k) for gate in gates] for k in range(3)]
        for k in range(2):
            lanes.append(
                Lanelet(
                    10 * part + k + 1,
                    left=edges[k + 1],
                    right=edges[k],
                    left_tags=SOLID if k else DASHED,
                    right_tags=DASHED if k else SOLID,
                )
            )
    for arm in range(4):
        angle = 90.0 * arm
        far = [(60 * cos(radians(angle + side)), 60 * sin(radians(angle + side))) for side in (-5, 5)]
        # Entries join 45 degrees behind the arm, exits leave 45 degrees before it: no weaving across arms.
        lanes += row([500 + arm], centred(*far[1], angle + 180), at((angle + 45) % 360).lane(0))
        lanes += row([600 + arm], at(angle).lane(0), centred(*far[0], angle))
    return Drawn(lanes)


def offset_crossing_with_lights() -> Drawn:
    """Two lanes crossed by two lanes, lights on one approach only, a stop line beside them."""
    drawn = intersection(lanes=2)
    drawn.lines = [Line(910, [(20, 3), (20, 6)], {"type": "traffic_light"}), Line(911, [(17, 0), (17, 7)])]
    drawn.relations.append(rule(900, "traffic_light", [("refers", 910), ("ref_line", 911)]))
    drawn.lanelets = [
        _with_rule(lane, 900) if lane.lanelet_id in (100, 101) else lane for lane in drawn.lanelets
    ]
    return drawn


def tiny_lanelets() -> Drawn:
    """Lanelets of 5 and 10 centimetres, shorter than SUMO's shortest lane, around a crossing."""
    xs = [-40, -20, -19.95, -5.1, -5, 5, 5.05, 5.1, 40]
    lanes = chain(1, [centred(x, 0) for x in xs])
    return Drawn(lanes + chain(51, [centred(0, y, 90) for y in (-40, -5.05, -5, 5, 40)]))


def ends_beside() -> Drawn:
    """A side road that ends at the edge of another road's lane without joining it."""
    lanes = chain(1, [centred(x, 0) for x in (-60, -20, 20, 60)])
    return Drawn(lanes + row([11], centred(-5, -40, 90), centred(-5, -2, 90)))


MAPS: dict[str, Callable[[], Drawn]] = {
    function.__name__: function
    for function in (
        short_lanelets,
        lane_opens,
        kinks,
        border_fork,
        starts_inside,
        two_steps_apart,
        both_ways,
        same_ground_both_ways,
        loop_of_one,
        roundabout_of_four,
        partners_across_a_crossing,
        ends_together,
        u_turn,
        wide_intersection,
        five_arms,
        neighbouring_crossings,
        spiral,
        tiny_lanelets,
        ends_beside,
        bridge,
        roundabout_of_two_lanes,
        offset_crossing_with_lights,
    )
}
