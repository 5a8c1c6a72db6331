"""Outlines of the nodes of a SUMO net."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import shapely
from shapely import MultiPoint, Polygon, unary_union

from scex_sumo.arrays import FloatArray
from scex_sumo.converters.net.elements import Edge
from scex_sumo.geometry.polylines import along, cut, heading, project
from scex_sumo.road import Lane


def lane_area(lane: Lane, span: tuple[float, float]) -> Polygon:
    """Surface of a stretch of a lane.

    Args:
        lane: the lane.
        span: where the stretch begins and ends on its centreline, m.
    """
    ends = along(lane.centreline, np.array(span))
    sides = [_between(bound, ends) for bound in (lane.left_bound, lane.right_bound)]
    return Polygon(np.vstack([sides[0], sides[1][::-1]])).buffer(0)


def union_outline(areas: Sequence[Polygon]) -> FloatArray:
    """(P, 2) outline of areas together; the convex hull of those that do not touch, nothing of lines."""
    union = unary_union(shapely.buffer(areas, 0.01, quad_segs=16))
    hull = union if union.geom_type == "Polygon" else union.convex_hull
    if hull.geom_type != "Polygon":
        return np.empty((0, 2))
    return np.asarray(hull.simplify(0.05).exterior.coords)[:-1]


def border(node: str, edges: Iterable[Edge]) -> FloatArray:
    """(P, 2) corners of the lanes that end or begin at a node without an inside."""
    points: list[FloatArray] = []
    for edge in edges:
        for lane in edge.lanes:
            for name, end in ((edge.start, False), (edge.end, True)):
                if name == node:
                    angle = heading(lane.shape, end=end)
                    across = np.array([-np.sin(angle), np.cos(angle)]) * lane.width / 2
                    tip = lane.shape[-1 if end else 0]
                    points += [tip + across, tip - across]
    hull = MultiPoint(np.array(points)).convex_hull
    coords = hull.exterior.coords[:-1] if hull.geom_type == "Polygon" else hull.coords
    return np.asarray(coords)


def _between(bound: FloatArray, ends: FloatArray) -> FloatArray:
    """Part of a bound beside a stretch of the centreline, given the stretch's two end points."""
    start, end = project(ends, bound)[0]
    return (
        cut(bound, start, end) if end - start > 1e-3 else np.vstack([along(bound, start), along(bound, end)])
    )
