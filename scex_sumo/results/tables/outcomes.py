"""Outcomes of futures as tables: collisions with their severity and fault, and encounters of batches.

Perfectly plastic impact of two point masses: the speed change of a vehicle is the other's share of both
masses times the relative speed. P(MAIS 3+) of its occupant is a logistic curve of the speed change, a mean
over crash modes. That of somebody on foot or bicycle is one of the speed at which a vehicle hits them. The
fault is the class of each vehicle's part in a collision.

Sources: masses are those of SUMO's vehicle classes, and of the small car and the pick-up of AASHTO's MASH
(2016); curves NHTSA DOT HS 813 219, and of people Lubbe, Wu, Jeppsson 2022; classes of fault after nuPlan's
collision types (Caesar et al. 2021).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.converters.tracks.road_users import road_user
from scex_sumo.geometry.rectangles import Rectangles
from scex_sumo.metrics.base import SceneTracks
from scex_sumo.metrics.collisions import KINDS, SIDES, Collisions, Moves
from scex_sumo.metrics.evaluate import ScenarioValues
from scex_sumo.results.tables.columns import schema
from scex_sumo.road import Road
from scex_sumo.roads.matching import match

MASSES_KG: Final = {
    "car": ((4.3, 1100.0), (5.0, 1500.0), (6.0, 2270.0)),  # MASH 1100C; passenger; MASH 2270P
    "van": ((5.0, 1500.0), (6.5, 5000.0)),  # passenger; delivery
    "truck": ((7.1, 4500.0), (16.5, 13000.0)),  # truck; trailer
    "bus": ((12.0, 12000.0), (14.0, 25000.0)),  # bus; coach
    "motorcycle": ((2.2, 200.0),),
    "pedestrian": ((0.6, 80.0),),
    "bicycle": ((1.8, 80.0),),  # with the cyclist
}
"""Mass by type: pairs of length in m and mass in kg, linear between them, constant beyond."""

MAIS3: Final = (-6.9540, 0.1637)
"""Intercept and slope per mph of the logistic curve of an occupant's severe injury."""

STRUCK: Final = {"pedestrian": (29.0, 0.078), "bicycle": (44.0, 0.079)}
"""Closing speed at which one of ten is injured severely (MAIS 3+), km/h, and slope of the curve per km/h.

Logistic curves of crashes of GIDAS with the front of a car, at mean age (Lubbe, Wu, Jeppsson 2022).
"""

COVERED: Final = frozenset(("car", "van"))
"""Types whose occupants the curves were fitted to; for others P(MAIS 3+) is undefined."""

FAULTS: Final = (
    "hits standing",
    "stands",
    "hits from behind",
    "leaves lane",
    "other leaves lane",
    "against priority",
    "other against priority",
    "hits the side",
    "other hits the side",
)
"""Classes of the first vehicle's part in a collision; the first one that holds. It has the fault in
``hits standing``, ``hits from behind``, ``leaves lane``, ``against priority`` and ``hits the side``, else the
other one."""

UNDECIDED: Final = -1
_NO_MASS = ((0.0, np.nan),)
MPH: Final = 0.44704  # m/s
_STANDING_MPS = 0.05  # as nuPlan's
_OUTSIDE_M = 0.25  # a corner this far outside of its lane has left it


@dataclass(frozen=True, kw_only=True, eq=False)
class Severity:
    """Severity and fault of N collisions, (N,) each.

    Attributes:
        delta_v: speed change of the first vehicle, m/s; NaN if one of both has no mass.
        delta_v_other: of the second one.
        p_mais3: probability of a MAIS 3+ injury of an occupant of the first vehicle, or of the first one on
            foot or bicycle; NaN for types that the curves do not cover, and of people that walk or ride into
            a standing vehicle.
        p_mais3_other: of the second one.
        fault: index into `FAULTS`; -1 if undecided.
    """

    delta_v: FloatArray
    delta_v_other: FloatArray
    p_mais3: FloatArray
    p_mais3_other: FloatArray
    fault: IntArray

    def faults(self) -> list[str | None]:
        """Return the classes in words; None where undecided."""
        return [FAULTS[k] if k != UNDECIDED else None for k in self.fault.tolist()]


def masses(types: Sequence[str], length: FloatArray) -> FloatArray:
    """Return the mass (V,) of vehicles by type and length in m, kg; NaN for types not in `MASSES_KG`."""
    known: list[Any] = [tuple(zip(*MASSES_KG.get(road_user(kind), _NO_MASS), strict=True)) for kind in types]
    return np.array([np.interp(long, *points) for long, points in zip(length, known, strict=True)])


def _injuries(kinds: NDArray[np.str_], share: FloatArray, closing: FloatArray) -> FloatArray:
    """Return (2, N) probabilities of a severe injury (MAIS 3+) of one person of each of two road users.

    People on foot or bicycle are injured by the closing speed; in a vehicle that hits them nobody is: 0.

    Args:
        kinds: (2, N) types of the first and of the second one.
        share: (2, N) of the other's mass in both masses.
        closing: (N,) speed, m/s.
    """
    curves = [[STRUCK.get(kind, (np.nan, np.nan)) for kind in side] for side in kinds]
    tenth, slope = np.moveaxis(np.array(curves).reshape(2, -1, 2), 2, 0)
    odds = np.exp(slope * (3.6 * closing - tenth)) / 9
    people = odds / (1 + odds)
    inside = 1.0 / (1.0 + np.exp(-(MAIS3[0] + MAIS3[1] * (share * closing) / MPH)))
    inside = np.where(np.isnan(people[::-1]), inside, 0.0)
    return np.where(np.isnan(people), inside, people)


def severity_of(
    tracks: SceneTracks, hits: Collisions, types: Sequence[str], road: Road | None = None
) -> Severity:
    """Compute severity and fault of collisions.

    Args:
        tracks: the tracks that ``hits`` were found in, with lengths (V,).
        types: (V,) of the vehicles.
        road: lanes and right of way; without it the impact alone decides.
    """
    start, pair = max(tracks.first - 1, 0), (hits.first, hits.second)
    moves = Moves(tracks, hits.future, hits.step - 1, *pair)
    share = np.clip(hits.time_s / tracks.step_s - (moves.step - start), 0.0, 1.0)
    stands = [np.abs(moves.speed(vehicle, share)) <= _STANDING_MPS for vehicle in pair]
    mass = masses(types, tracks.length)[np.stack(pair)]
    shares = mass[::-1] / mass.sum(axis=0)
    kinds = np.array([[road_user(types[v]) for v in side.tolist()] for side in pair], dtype=np.str_)
    walks, covered = np.isin(kinds, [*STRUCK]), np.isin(kinds, [*COVERED])
    risks = _injuries(kinds, shares, hits.relative_speed)
    risks = np.where(walks & ~np.stack(stands)[::-1] | covered, risks, np.nan)
    changes = shares * hits.relative_speed
    return Severity(
        delta_v=changes[0],
        delta_v_other=changes[1],
        p_mais3=risks[0],
        p_mais3_other=risks[1],
        fault=_faults(hits, stands, road, moves.poses(share)),
    )


def _faults(
    hits: Collisions, stands: Sequence[BoolArray], road: Road | None, poses: tuple[Rectangles, Rectangles]
) -> IntArray:
    fronts = [side == SIDES.index("front") for side in (hits.first_side, hits.second_side)]
    none = np.zeros(len(hits), dtype=np.bool_)
    leaves, against = [none, none], [none, none]
    if road is not None and len(hits):
        leaves, against = _on_road(road, poses)
    holds = [
        stands[1] & ~stands[0],
        stands[0] & ~stands[1],
        hits.kind == KINDS.index("rear-end"),
        leaves[0] & ~leaves[1],
        leaves[1] & ~leaves[0],
        against[0],
        against[1],
        fronts[0] & ~fronts[1],
        fronts[1] & ~fronts[0],
    ]
    return np.select(holds, range(len(FAULTS)), default=UNDECIDED).astype(np.int64)


def _on_road(road: Road, poses: tuple[Rectangles, Rectangles]) -> tuple[list[BoolArray], list[BoolArray]]:
    """Return (N,) whether either vehicle is outside of its lane, and whether it must give way."""
    lanes, leaves = [], []
    for pose in poses:
        matches = match(road, pose.x, pose.y, pose.heading)
        best = matches.best
        vehicle = matches.vehicle[best]
        lane = np.full(len(pose.x), UNDECIDED)
        lane[vehicle] = matches.lane_id[best]
        width = np.array([road.lanes[k].width_m for k in matches.lane_id[best].tolist()])
        turn, half = matches.heading_error[best], pose.half_length[vehicle]
        reach = half * np.abs(np.sin(turn)) + pose.half_width[vehicle] * np.abs(np.cos(turn))
        out = np.ones(len(pose.x), dtype=np.bool_)
        out[vehicle] = np.abs(matches.offset[best]) + reach > width / 2 + _OUTSIDE_M
        lanes.append(lane)
        leaves.append(out)
    yielding = _yielding(road)
    first, second = ([_with_before(road, lane) for lane in side.tolist()] for side in lanes)
    against = [
        [not yielding.isdisjoint(product(own, other)) for own, other in zip(*sides, strict=True)]
        for sides in ((first, second), (second, first))
    ]
    one_yields, other_yields = np.array(against, dtype=np.bool_)
    return leaves, [one_yields & ~other_yields, other_yields & ~one_yields]


def _yielding(road: Road) -> set[tuple[int, int]]:
    """Return the pairs of a lane that must give way and a lane that has priority over it."""
    rules = [rule for rule in road.regulations if rule.kind != "all_way_stop"]
    return {(a, b) for rule in rules for a in rule.yielding for b in rule.priority}


def _with_before(road: Road, lane: int) -> tuple[int, ...]:
    """Return a lane and those before it: rules name the approach to a conflict; none off the lanes."""
    return (lane, *road.lanes[lane].predecessors) if lane in road.lanes else ()


COLLISIONS_SCHEMA: Final = schema(
    "future step time_s track_id other_id kind side other_side relative_speed overlap x y",
    "delta_v delta_v_other p_mais3 p_mais3_other fault consequence",
)
"""``step`` is the first one after the impact at ``time_s``; both count from the seed moment. ``delta_v`` to
``fault`` are those of `Severity`; ``p_mais3`` is null for types that the curve does not cover. A
``consequence`` is a contact of a vehicle that had collided before; no probability counts it."""

SMALL: Final = {"first": np.int32, "second": np.int32, "kind": np.int8, "towards": np.int8}
"""Types of encounters in the parts of a run."""

CONFLICTS: Final = "conflicts.parquet"
"""One row for each pair and human-like future; vehicles by index into `everybody` of the seed scene."""


def collisions_table(
    hits: Collisions, severity: Severity, *, futures: IntArray, track_ids: IntArray, first: int
) -> pa.Table:
    """Tabulate the collisions of C futures with numbers (C,), by future, time and pair.

    In a rear-end collision ``track_id`` hits ``other_id``.
    """
    sides, ids = np.array(SIDES), np.asarray(track_ids)
    columns = vars(hits) | {
        "future": np.asarray(futures)[hits.future],
        "step": hits.step - first + 1,
        "track_id": ids[hits.first],
        "other_id": ids[hits.second],
        "kind": hits.kinds(),
        "side": sides[hits.first_side],
        "other_side": sides[hits.second_side],
        **{name: pa.array(v, from_pandas=True) for name, v in vars(severity).items()},  # NaN is null
        "fault": pa.array(severity.faults(), pa.string()),
    }
    arrays = {name: pa.array(columns[name]) for name in COLLISIONS_SCHEMA.names}
    return pa.table(arrays, schema=COLLISIONS_SCHEMA)


def first_contacts(collisions: pa.Table) -> pa.Table:
    """Return the rows of ``collisions.parquet`` without consequences of earlier collisions."""
    return collisions.filter(pc.invert(collisions["consequence"]))


def collided(table: pa.Table, futures: IntArray) -> BoolArray:
    """Return (C,) whether futures have a collision in the table."""
    hit: BoolArray = np.isin(futures, np.asarray(table["future"]))
    return hit


def worst_table(values: ScenarioValues, *, futures: IntArray, track_ids: IntArray) -> pa.Table:
    """Tabulate the origin of each future's extrema: ``worst.parquet``; times are those of ``tracks.parquet``.

    Args:
        futures: (C,) numbers.
        track_ids: (V,).

    Returns:
        future, metric, timestamp_ms, track_id, other_id (null for single vehicles), value; no row where
        undefined.
    """
    parts = []
    for name, worst in values.worst.items():
        rows = worst.take(defined := np.flatnonzero(worst.defined))
        columns = {
            "future": futures[defined],
            "metric": pa.repeat(pa.scalar(name), len(defined)),
            "timestamp_ms": 100 * (rows.step + 1),
            "track_id": track_ids[rows.vehicle],
            "other_id": other_ids(None if rows.other is None else track_ids[rows.other], len(defined)),
            "value": rows.value,
        }
        parts.append(pa.table(columns))
    return pa.concat_tables(parts).sort_by([("future", "ascending")])


def other_ids(ids: IntArray | None, count: int) -> pa.Array:
    """Column of the second vehicles' ids; null everywhere for a metric of single vehicles."""
    return pa.nulls(count, pa.int64()) if ids is None else pa.array(ids, pa.int64())
