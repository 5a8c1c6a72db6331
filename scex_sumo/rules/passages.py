"""Passages of junctions along the paths of a seed scene, where they conflict; lights, places of vehicles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import shapely

from scex_sumo.base.arrays import BoolArray, FloatArray, IntArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.behaviors.driving.paths import DS_M, SeedPaths, path_positions
from scex_sumo.geometry.polylines import along, length_of, samples
from scex_sumo.road_rules import Rules
from scex_sumo.roads.conflicts import close_span
from scex_sumo.scene import SceneHistory, VehicleIndex

NO_SIGN = ""  # state of links of which a map says nothing
NEAR_M = 1.5  # between a path and the passage that it takes; the next lane is 3 m away
LONGER = 1.3, 4.0  # a path may be so many times longer than a passage, and m
LINE_M = 15.0  # before a passage, for its drawn stop line
CLEARANCE_M = 2.6  # of centrelines on which two cars touch
STEP_M = 0.5
STANDS_MPS = 0.5
GAIN_STEPS = 3
GREEN, YELLOW, RED = "Gg", "yY", "rRu"


@dataclass(frozen=True, kw_only=True, eq=False)
class RuledWays:
    """Passages on the paths of a seed scene: E passages on paths, sorted by path; K pairs that conflict."""

    row: IntArray  # (E,) path
    signal: IntArray  # (E,) -1 without
    state: np.ndarray[tuple[int], np.dtype[np.str_]]  # (E,) of the link
    stop: FloatArray  # (E,) arc length on the path where a vehicle stops, m
    end: FloatArray  # (E,) where the passage ends, m
    first: IntArray  # (P + 1,) entries of path p are ``first[p]`` to ``first[p + 1]``
    own: IntArray  # (K,) entry that gives way; sorted
    other: IntArray  # (K,) entry that has priority
    own_span: FloatArray  # (K, 2) arc lengths of the conflict on the path that gives way, m
    other_span: FloatArray  # (K, 2) and on the other
    mutual: BoolArray  # (K,) whether both give way to each other
    merges: BoolArray  # (K,) whether they lead to one lane
    vehicle: IntArray  # (P,) vehicle of each path
    walks: FloatArray  # (W, 4) path, begin and end of each crosswalk on it, m, and index of the crosswalk

    @property
    def unsigned(self) -> BoolArray:
        """(E,) whether the map says nothing of the passages."""
        return np.asarray(self.state == NO_SIGN)


@owner_cache
def ruled_ways(paths: SeedPaths, rules: Rules) -> RuledWays:
    """Find the passages on all paths, and where they conflict."""
    table = paths.table.reshape(*paths.x.shape, -1)
    entries: list[tuple[int, int, float, float, float]] = []
    boxes = shapely.STRtree([shapely.LineString(p.line) for p in rules.passages])
    stops = shapely.STRtree([shapely.LineString(line) for line in rules.stop_lines])
    marks = _marks(rules)
    for path, points in enumerate(table[:, :, :2]):
        line = shapely.LineString(points)
        for k in np.sort(boxes.query(line, "dwithin", NEAR_M)).tolist():
            if (place := _place(points, table[path, :, 2:4], *marks[k])) is not None:
                entries.append((path, k, _stop(points, place[0], rules, stops), *place))
    rows, passage = (np.array([e[i] for e in entries], dtype=np.int64) for i in (0, 1))
    stop, begin, end = (np.array([e[i] for e in entries]) for i in (2, 3, 4))
    own, other, spans = _pairs(rules, passage, begin, rows)
    yields = [set(p.yields_to) for p in rules.passages]
    mutual = [passage[a] in yields[passage[b]] for a, b in zip(own, other, strict=True)]
    walks = list[tuple[float, float, float, float]]()
    if rules.crosswalks:
        from scex_sumo.rules.crosswalks import walks_on

        walks += walks_on(table[:, :, :2], rules)
    return RuledWays(
        row=rows,
        signal=np.array([rules.passages[k].signal for k in passage.tolist()], dtype=np.int64),
        state=np.array([rules.passages[k].state for k in passage.tolist()], dtype="U1"),
        stop=stop,
        end=end,
        first=np.searchsorted(rows, np.arange(len(table) + 1)),
        own=own,
        other=other,
        own_span=spans[:, :2],
        other_span=spans[:, 2:],
        mutual=np.array(mutual, dtype=np.bool_),
        merges=(end[own] - spans[:, 1] < STEP_M) & (end[other] - spans[:, 3] < STEP_M),
        vehicle=np.repeat(np.arange(len(paths.count)), paths.count),
        walks=np.array(walks).reshape(-1, 4),
    )


@owner_cache
def _marks(rules: Rules) -> list[tuple[float, FloatArray]]:
    """Return the length of each passage, m, and its points (3, 2): begin, middle, end."""
    lengths = ((length_of(passage.line), passage.line) for passage in rules.passages)
    return [(length, along(line, np.array([0.0, length / 2, length]))) for length, line in lengths]


def _place(
    points: FloatArray, directions: FloatArray, length: float, marks: FloatArray
) -> tuple[float, float] | None:
    """Return the arc lengths where a passage (`_marks`) begins and ends on a path; None if not taken."""
    distance = np.hypot(*(points[:, None] - marks).transpose(2, 0, 1))
    sample = distance.argmin(axis=0)
    if (distance[sample, range(3)] > NEAR_M).any() or not sample[0] <= sample[1] <= sample[2]:
        return None
    begin, end = DS_M * float(sample[0]), DS_M * float(sample[2])
    step = marks[1] - marks[0]
    if directions[sample[0]] @ step < 0.5 * np.hypot(*step) or end - begin > LONGER[0] * length + LONGER[1]:
        return None
    return begin, end


def _stop(points: FloatArray, begin: float, rules: Rules, stops: shapely.STRtree) -> float:
    """Return where a vehicle stops before a passage: at the drawn stop line, else where it begins."""
    first = int(max(begin - LINE_M, 0.0) / DS_M)
    before = points[first : int(begin / DS_M) + 3]
    if not len(rules.stop_lines) or len(before) < 2:
        return begin
    line = shapely.LineString(before)
    crossed = (stops.geometries[k] for k in stops.query(line, "intersects"))
    met = [line.project(line.intersection(stop).centroid) for stop in crossed]
    return DS_M * first + max(met) if met else begin


def _pairs(
    rules: Rules, passage: IntArray, begin: FloatArray, path: IntArray
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return pairs of entries of which the first gives way, and the spans (K, 4) of their conflicts."""
    on: dict[int, list[int]] = {}
    for entry, k in enumerate(passage.tolist()):
        on.setdefault(k, []).append(entry)
    lines, span_of = [p.line for p in rules.passages], dict[tuple[int, int], FloatArray | None]()
    pairs, spans = [], []
    for entry, k in enumerate(passage.tolist()):
        for foe in rules.passages[k].yields_to:
            for theirs in on.get(foe, ()):
                if (k, foe) not in span_of:
                    span_of[k, foe] = _spans(lines[k], lines[foe])
                span = span_of[k, foe]
                if span is not None and path[entry] != path[theirs]:
                    pairs.append((entry, theirs))
                    spans.append(span + np.repeat([begin[entry], begin[theirs]], 2))
    own, other = np.array(pairs, np.int64).reshape(-1, 2).T
    return own, other, np.array(spans).reshape(-1, 4)


def _spans(line: FloatArray, other: FloatArray) -> FloatArray | None:
    """Return begin and end of a conflict on two lines, (4,) m; None if they keep clear of each other."""
    own = close_span(samples(line, STEP_M), other, CLEARANCE_M)
    theirs = close_span(samples(other, STEP_M), line, CLEARANCE_M)
    return None if own is None or theirs is None else np.array([*own, *theirs])


@dataclass(frozen=True, eq=False)
class Lit:
    """Lights now: (1 or C, G + 1), of all futures or of each; the last one is that of passages without."""

    red: BoolArray
    yellow: BoolArray
    green: BoolArray
    free: BoolArray  # green with priority
    stop: BoolArray
    ready: BoolArray  # red and yellow: green follows
    since_s: FloatArray  # how long it has been shown, s

    @classmethod
    def at(cls, rules: Rules, time_s: float) -> Lit:
        """Return the lights at a time since the seed moment."""
        shown = [*(signal.at(time_s) for signal in rules.signals), ("", 0.0)]
        letters = np.array([[letter for letter, _ in shown]])
        kinds = RED, YELLOW, GREEN, "G", "s", "u"
        red, yellow, green, free, stop, ready = (np.isin(letters, [*kind]) for kind in kinds)
        return cls(red, yellow, green, free, stop, ready, np.array([[since for _, since in shown]]))

    def of(self, name: str, future: IntArray, signal: IntArray) -> Any:
        """Return what signals (m,) show in futures (m,)."""
        values = getattr(self, name)
        return values[future % len(values), signal]


class Traffic(NamedTuple):
    """Places of all vehicles on their paths: (C, V) path, front and rear, m, and speed, m/s."""

    row: IntArray
    front: FloatArray
    rear: FloatArray
    speed: FloatArray
    slowest: FloatArray  # (C, V) speed in the last second, m/s
    gained: FloatArray  # (C, V) speed in the last three steps, m/s


def traffic_on(history: SceneHistory, paths: SeedPaths, path: IntArray) -> Traffic:
    """Return the places of all vehicles on paths (C, V)."""
    now = history.now
    s, _, _ = path_positions(history, VehicleIndex.everyone(history), paths, path.ravel())
    s, half = s.reshape(path.shape), history.scene.length / 2
    speed = history.states.speed
    slowest, gained = speed.min(axis=2), now.speed - speed[:, :, -1 - GAIN_STEPS]
    return Traffic(path, s + half, s - half, np.maximum(now.speed, 0.0), slowest, gained)


@owner_cache
def straight_traffic(history: SceneHistory, paths: SeedPaths) -> Traffic:
    """Return the places of all vehicles on their straightest paths."""
    path = np.broadcast_to(paths.first + paths.straight, history.now.shape)
    return traffic_on(history, paths, path)
