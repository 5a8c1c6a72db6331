"""The metrics once more, one pair at a time, by other means: high-precision roots, shapely, plain loops.

Written from the definitions alone; shares no code with the package.
"""

from __future__ import annotations

import math
from typing import Any

import mpmath
import numpy as np
from shapely import LineString, MultiPoint, Point, Polygon

mpmath.mp.dps = 50

Vehicle = dict[str, float]


def wttc(a: Vehicle, b: Vehicle, limit: float = 6.9) -> float:
    """Smallest t >= 0 at which the two discs touch, from all roots of the polynomial at 50 digits."""
    mpf = mpmath.mpf
    px, py = mpf(b["x"]) - mpf(a["x"]), mpf(b["y"]) - mpf(a["y"])
    vx = mpf(b["v"]) * mpmath.cos(b["psi"]) - mpf(a["v"]) * mpmath.cos(a["psi"])
    vy = mpf(b["v"]) * mpmath.sin(b["psi"]) - mpf(a["v"]) * mpmath.sin(a["psi"])
    radius = sum(mpmath.hypot(mpf(c["length"]) / 2, mpf(c["width"]) / 2) for c in (a, b))
    reach = 2 * mpf(limit)
    if mpmath.hypot(px, py) <= radius:
        return 0.0
    roots = mpmath.polyroots(
        [
            -(reach**2) / 4,
            0,
            vx**2 + vy**2 - reach * radius,
            2 * (px * vx + py * vy),
            px**2 + py**2 - radius**2,
        ],
        maxsteps=500,
        extraprec=200,
    )
    times = []
    for root in roots:
        t = mpmath.re(root)
        if abs(mpmath.im(root)) > mpf(10) ** -20 or t < 0:
            continue
        touching = mpmath.hypot(px + vx * t, py + vy * t) - (radius + reach * t**2 / 2)
        if abs(touching) < mpf(10) ** -15:
            times.append(t)
    return float(min(times))


def follows(follower: Vehicle, leader: Vehicle) -> bool:
    difference = math.remainder(follower["psi"] - leader["psi"], math.tau)
    dx, dy = leader["x"] - follower["x"], leader["y"] - follower["y"]
    ahead = dx * math.cos(follower["psi"]) + dy * math.sin(follower["psi"])
    return abs(difference) <= math.radians(30) and ahead > 0


def ttc(follower: Vehicle, leader: Vehicle) -> float | None:
    if not follows(follower, leader):
        return None
    d = math.dist((follower["x"], follower["y"]), (leader["x"], leader["y"]))
    closing = follower["v"] - leader["v"]
    return d / closing if closing > 0 else math.inf


def pttc(follower: Vehicle, leader: Vehicle) -> float | None:
    time = ttc(follower, leader)
    braking = max(0.0, -leader["a"])
    if time is None or braking == 0:
        return time
    mpf = mpmath.mpf
    d = mpmath.hypot(mpf(follower["x"]) - leader["x"], mpf(follower["y"]) - leader["y"])
    c, big, v = mpf(follower["v"]) - mpf(leader["v"]), mpf(braking), mpf(leader["v"])
    t = (-c + mpmath.sqrt(c * c + 2 * big * d)) / big
    if t <= v / big:
        return float(t)
    if follower["v"] == 0:
        return math.inf
    return float((d + v * v / (2 * big)) / follower["v"])


def gap_time(path_a: Any, path_b: Any, speed_a: float, speed_b: float) -> float | None:
    """By shapely: the crossing point that is nearest along path a."""
    if min(speed_a, speed_b) <= 1e-4:
        return None
    path_a, path_b = _distinct(path_a), _distinct(path_b)
    if min(len(path_a), len(path_b)) < 2:
        return None
    line_a, line_b = LineString(path_a), LineString(path_b)
    best: tuple[float, float] | None = None
    for index, start in enumerate(path_a[:-1]):
        piece = LineString([start, path_a[index + 1]])
        points = piece.intersection(line_b)
        for point in _points(points):
            own = LineString(path_a[: index + 1]).length if index else 0.0
            own += math.dist(start, (point.x, point.y))
            candidate = (own, line_b.project(point))
            best = candidate if best is None or candidate[0] < best[0] else best
    del line_a
    return None if best is None else abs(best[0] / speed_a - best[1] / speed_b)


def _points(geometry: Any) -> list[Point]:
    if isinstance(geometry, Point):
        return [] if geometry.is_empty else [geometry]
    if isinstance(geometry, MultiPoint):
        return list(geometry.geoms)
    return []


def _distinct(path: Any) -> list[tuple[float, float]]:
    kept: list[tuple[float, float]] = []
    for x, y in path:
        if not kept or math.dist(kept[-1], (x, y)) > 0:
            kept.append((float(x), float(y)))
    return kept


def rectangle(vehicle: Vehicle) -> Polygon:
    c, s = math.cos(vehicle["psi"]), math.sin(vehicle["psi"])
    half_l, half_w = vehicle["length"] / 2, vehicle["width"] / 2
    corners = [(half_l, half_w), (-half_l, half_w), (-half_l, -half_w), (half_l, -half_w)]
    return Polygon([(vehicle["x"] + c * a - s * b, vehicle["y"] + s * a + c * b) for a, b in corners])


def variation(speeds: list[float]) -> float:
    if not speeds or np.mean(speeds) < 1e-5:
        return 0.0
    return float(np.std(speeds) / np.mean(speeds))


def tq(scene: list[Vehicle], windows: list[tuple[list[float], list[float]]]) -> list[float]:
    """TQ of all vehicles; ``windows`` holds their accelerations and speeds of the last 2 s."""
    smallest = min(rectangle(a).distance(rectangle(b)) for i, a in enumerate(scene) for b in scene[:i])
    macro = variation([v["v"] for v in scene])
    values = []
    for index, own in enumerate(scene):
        radius = (3.6 * own["v"] / 10) ** 2 + own["length"] + own["v"]
        near = [
            v["v"]
            for other, v in enumerate(scene)
            if other != index and math.dist((v["x"], v["y"]), (own["x"], own["y"])) <= radius
        ]
        accelerations, speeds = windows[index]
        load = 0.5 * (abs(np.mean(accelerations)) / 1.5 + np.mean(speeds) / 13.89)
        terms = (macro, len(near) / len(scene), variation(near), load)
        values.append(math.exp(-smallest / 5) * math.sqrt(sum(t * t for t in terms)))
    return values
