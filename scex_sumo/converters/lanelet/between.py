"""Lanelets that a map lacks between two others, although a lanelet goes on behind the gap."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.lanelet.file import MapFile, Member, Relation, free_ids
from scex_sumo.converters.lanelet.lanes import MIN_ROAD_M, Rules, Vertex

MAX_LANE_M = 4.5


def missing_lanelets(vertices: Sequence[Vertex], rules: Rules, map_file: MapFile) -> dict[int, Relation]:
    """Return the lanelets to add, by new id.

    One is missing where a lanelet begins at the right end of one lanelet and the left end of another, nothing
    leads into it, and the facing bounds have no lanelet between them and the distance of those of a lane.
    """
    drives = [v for v in vertices if rules.canPass(v.lanelet) and v.lane_id == v.lanelet_id]
    ends = {(_place(v.left, -1), _place(v.right, -1)) for v in drives}
    on_left, on_right = ({_place(getattr(v, side), -1): v for v in drives} for side in ("right", "left"))
    refs = {
        side: {r for i in map_file.of_type("lanelet").values() for r in i.refs(side, "way")}
        for side in ("left", "right")
    }
    added: dict[int, Relation] = {}
    ids = free_ids((*map_file.relations, *map_file.ways, *map_file.nodes))
    for lane in drives:
        begin = _place(lane.left, 0), _place(lane.right, 0)
        one, other = on_left.get(begin[0]), on_right.get(begin[1])
        if begin in ends or one is None or other is None or one is other:
            continue
        before = map_file.relations[one.lanelet_id]
        left = before.refs("right", "way")[0]
        right = map_file.relations[other.lanelet_id].refs("left", "way")[0]
        if left in refs["left"] or right in refs["right"] or not _is_wide(one.right, other.left):
            continue
        bounds = tuple(
            Member(kind="way", ref=ref, role=side) for ref, side in ((left, "left"), (right, "right"))
        )
        added[next(ids)] = Relation(members=bounds, tags=before.tags)
    return added


def _place(line: FloatArray, end: int) -> tuple[float, ...]:
    return tuple(line[end].tolist())


def _is_wide(left: FloatArray, right: FloatArray) -> bool:
    """Return whether two bounds are as far apart as those of a lane, all the way."""
    apart = np.hypot(*(left[:, None] - right).transpose(2, 0, 1))
    ends = (apart[0, 0], apart[-1, -1])
    return bool(min(ends) >= MIN_ROAD_M and max(ends) <= MAX_LANE_M)
