"""Picture of a road and of vehicles as SVG."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from scex_sumo.converters.net.reading import AREA, MARKING, SURFACE, RoadLine
from scex_sumo.page.html import Html, element, joined
from scex_sumo.page.report.scene import ROAD_UNIT_M, Box, road_paths
from scex_sumo.road import Road


def lane_lines(road: Road, box: Box = (-np.inf, np.inf, -np.inf, np.inf)) -> list[RoadLine]:
    """Return the lanes of a road that touch a box, without its net: their areas and bounds."""
    left, right, low, high = box
    corner, opposite = np.array([left, low]), np.array([right, high])
    lanes = [
        lane
        for lane in road.vehicle_lanes.values()
        if (lane.left_bound.min(axis=0) <= opposite).all() and (lane.left_bound.max(axis=0) >= corner).all()
    ]
    asphalt = [lane.outline for lane in lanes]
    bounds = [bound for lane in lanes for bound in (lane.left_bound, lane.right_bound)]
    return [RoadLine(AREA, 0.0, area) for area in asphalt] + [RoadLine(MARKING, 0.0, line) for line in bounds]


def road_svg(road: Iterable[RoadLine]) -> Html:
    """Return the lines of a road for `scene_svg`."""
    parts = []
    for group in road_paths(road):
        kind = {SURFACE: "lane", AREA: "junction"}.get(group["kind"], "marking")
        width = f"{(group['width'] or 0.15) / ROAD_UNIT_M:g}"
        scale = f"scale({ROAD_UNIT_M})"
        parts.append(element(f"path.{kind}", d=group["path"], stroke_width=width, transform=scale))
    return joined(*parts)


def scene_svg(name: str, box: Box, road: Html, shapes: Sequence[Html]) -> Html:
    """Return a picture of the road in a box (least and largest x, y), and of outlines as of `outline_svg`."""
    left, right, low, high = box
    upwards = element("g", road, *shapes, transform="scale(1 -1)")
    view = f"{left:.1f} {-high:.1f} {right - left:.1f} {high - low:.1f}"
    return element("svg.scene", upwards, viewBox=view, role="img", aria_label=name)


def outline_svg(kind: str, length: float, width: float) -> Html:
    """Return the outline of a vehicle at the origin, which a script moves."""
    box = {"x": f"{-length / 2:.2f}", "y": f"{-width / 2:.2f}", "width": f"{length:.2f}"}
    return element(f"rect.{kind}", height=f"{width:.2f}", **box)
