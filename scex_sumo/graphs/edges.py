"""Edges of the semantic scene graph: lane relations of vehicle pairs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scex_sumo.base.arrays import FloatArray, IntArray, least_of
from scex_sumo.roads.relations import BESIDE_M, CONFLICT_M, LaneRelations
from scex_sumo.scene import States

KINDS = ("ahead", "behind", "lateral", "intersecting")
AHEAD, BEHIND, LATERAL, INTERSECTING = range(4)
EDGE_COLUMNS = (
    *(f"is_{kind}" for kind in KINDS),
    "path_distance",  # m, of the source from the target along the lanes, positive ahead; 0 if intersecting
    "target_offset",  # m, from the centreline, left positive
    "source_offset",
    "target_to_crossing",  # m, along the lanes; 0 unless intersecting
    "source_to_crossing",
    "target_probability",  # of the match with the lane
    "source_probability",
    "speed_difference",  # m/s, source minus target
    "x",  # m, of the source in the target's frame: ahead
    "y",  # to the left
    "cos",  # of the source's heading in the target's frame
    "sin",
)
WAY_M = 100.0  # along the lanes, for vehicles ahead or behind
SECOND_MATCH = 0.2  # from this probability on
MATCHES = 2  # lanes per vehicle


class Located(NamedTuple):
    """Lanes of N vehicles: the most probable one in row 0, the second in row 1."""

    lane: IntArray  # (MATCHES, N) number in the road index; arbitrary at probability 0
    s: FloatArray  # (MATCHES, N) arc length on it, m
    offset: FloatArray  # (MATCHES, N) from its centreline, m, left positive
    heading_error: FloatArray  # (MATCHES, N) vehicle minus lane, rad
    probability: FloatArray  # (MATCHES, N) 0 without a match


def scene_edges(
    target: IntArray,
    source: IntArray,
    now: States,
    length: FloatArray,
    place: Located,
    relations: LaneRelations,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Find the relations of M pairs of vehicles that are on the road; of two lanes, the likeliest counts.

    Args:
        target: (M,) node; ``source`` too.
        now: (N,) present states.
        length: (N,) m.

    Returns:
        (2, E) nodes of source, which influences, and target; (E,) index into `KINDS`; (E, G) `EDGE_COLUMNS`.
    """
    pair, on_target, on_source = _combinations(target, source, place)
    t, s = target[pair], source[pair]
    joint = place.probability[on_target, t] * place.probability[on_source, s]
    lanes = place.lane[on_target, t], place.lane[on_source, s]
    arc_lengths = place.s[on_target, t], place.s[on_source, s]
    kinds, distance, to_crossing = _relate(lanes, arc_lengths, (length[t] / 2, length[s] / 2), relations)
    related = np.flatnonzero(kinds >= 0)
    # Of equals the first kind, then the first match.
    related = related[least_of(pair[related], -joint[related], kinds[related])]
    kind, target, source = kinds[related], t[related], s[related]
    at_target, at_source = (on_target[related], target), (on_source[related], source)
    columns = (
        distance[related],
        place.offset[at_target],
        place.offset[at_source],
        *to_crossing[:, related],
        place.probability[at_target],
        place.probability[at_source],
        now.speed[source] - now.speed[target],
        *_relative(now, target, source),
    )
    features = np.empty((len(related), len(EDGE_COLUMNS)))
    features[:, : len(KINDS)] = kind[:, None] == np.arange(len(KINDS))
    for k, column in enumerate(columns, start=len(KINDS)):
        features[:, k] = column
    return np.stack([source, target]), kind, features


def _combinations(target: IntArray, source: IntArray, place: Located) -> tuple[IntArray, IntArray, IntArray]:
    second = place.probability[1] >= SECOND_MATCH
    of_target, of_source = np.flatnonzero(second[target]), np.flatnonzero(second[source])
    of_both = of_target[second[source[of_target]]]
    groups = (np.arange(len(target)), of_target, of_source, of_both)
    count = [len(group) for group in groups]
    return np.concatenate(groups), np.repeat([0, 1, 0, 1], count), np.repeat([0, 0, 1, 1], count)


def _relate(
    lanes: tuple[IntArray, IntArray],
    arc_lengths: tuple[FloatArray, FloatArray],
    halves: tuple[FloatArray, FloatArray],
    relations: LaneRelations,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return (M,) kinds, (M,) distances along the lanes, m, and (2, M) ways to where lanes meet, m.

    Arguments are (M,) of targets and sources: lanes, arc lengths and half lengths, m.
    """
    (lane_t, lane_s), (s_t, s_s), (half_t, half_s) = lanes, arc_lengths, halves
    ahead, behind = _along(lane_t, lane_s, s_s - s_t, relations)
    kind = np.where(np.minimum(ahead, behind) <= WAY_M, np.where(ahead <= behind, AHEAD, BEHIND), -1)
    distance = np.where(kind == AHEAD, ahead, np.where(kind == BEHIND, -behind, 0.0))

    unrelated = np.flatnonzero((kind < 0) & (relations.side[lane_t, lane_s] != 0))
    pair = (lane_t[unrelated], lane_s[unrelated])
    lead = relations.lead[pair] + relations.stretch_b[pair] * s_s[unrelated]
    lead -= relations.stretch_a[pair] * s_t[unrelated]
    near = np.abs(lead) - half_t[unrelated] - half_s[unrelated] <= BESIDE_M
    kind[unrelated[near]], distance[unrelated[near]] = LATERAL, lead[near]

    crossing = np.zeros((2, len(kind)))
    unrelated = np.flatnonzero(kind < 0)
    to_place = relations.meeting[lane_t[unrelated], lane_s[unrelated]]
    to_t, to_s = to_place[:, :, 0] - s_t[unrelated, None], to_place[:, :, 1] - s_s[unrelated, None]
    # A vehicle is before the place until its rear has cleared it.
    before = (to_t >= -half_t[unrelated, None]) & (to_s >= -half_s[unrelated, None])
    before &= (to_t <= CONFLICT_M) & (to_s <= CONFLICT_M)
    meeting = np.flatnonzero(before.any(axis=1))
    first = before[meeting].argmax(axis=1)
    kind[unrelated[meeting]] = INTERSECTING
    crossing[:, unrelated[meeting]] = to_t[meeting, first], to_s[meeting, first]
    return kind, distance, crossing


def _along(
    lane_t: IntArray, lane_s: IntArray, lead: FloatArray, relations: LaneRelations
) -> tuple[FloatArray, FloatArray]:
    """Return (M,) ways from target to source and back, m; inf without one."""
    ahead = relations.ahead[lane_t, lane_s] + lead
    behind = relations.ahead[lane_s, lane_t] - lead
    same = np.flatnonzero(lane_t == lane_s)
    round_again = relations.loop[lane_t[same]]
    ahead[same] += np.where(ahead[same] < 0, round_again, 0.0)
    behind[same] += np.where(behind[same] < 0, round_again, 0.0)
    return ahead, behind


def _relative(now: States, target: IntArray, source: IntArray) -> tuple[FloatArray, ...]:
    dx, dy = now.x[source] - now.x[target], now.y[source] - now.y[target]
    cos, sin = np.cos(now.heading), np.sin(now.heading)
    cos_t, sin_t, cos_s, sin_s = cos[target], sin[target], cos[source], sin[source]
    return (
        cos_t * dx + sin_t * dy,
        cos_t * dy - sin_t * dx,
        cos_s * cos_t + sin_s * sin_t,
        sin_s * cos_t - cos_s * sin_t,
    )
