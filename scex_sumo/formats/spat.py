"""Recorded signal phases (SPaT) as a SUMO traffic light that replays them.

The format of TAF-BW: a CSV ``signal_group_id, timestamp_ms, movement_state``, and beside it a KML whose lanes
name their sinks and signal groups (SAE J2735 MAP data).
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, TypeAlias

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import MapError, TrackError, one_line
from scex_sumo.converters.lanelet.projection import to_local
from scex_sumo.converters.naming import open_text
from scex_sumo.converters.net.sumo_net import RECORDED
from scex_sumo.converters.registries import Dataset
from scex_sumo.converters.xml import xml_root
from scex_sumo.formats.damage import refusing_damage
from scex_sumo.formats.recognition import is_spat
from scex_sumo.geometry.polylines import along, heading, length_of, project, turn
from scex_sumo.lanelet2sumo.plan.elements import Connection, NetLayout, Programme
from scex_sumo.lanelet2sumo.plan.lights import phase_state
from scex_sumo.road import Road

# SAE J2735 movement states in SUMO's letters.
LETTERS = {
    "DARK": "O",
    "UNAVAILABLE": "O",
    "STOP_THEN_PROCEED": "s",
    "STOP_AND_REMAIN": "r",
    "PRE_MOVEMENT": "u",
    "PERMISSIVE_MOVEMENT_ALLOWED": "G",
    "PROTECTED_MOVEMENT_ALLOWED": "G",
    "PERMISSIVE_CLEARANCE": "y",
    "PROTECTED_CLEARANCE": "y",
    "CAUTION_CONFLICTING_TRAFFIC": "o",
}
NEAR_M = 6.0  # along the lane, between the end of a lanelet and the stop line of the KML
BESIDE_M = 2.5  # across the lane
ALIGNED = math.radians(35.0)
CLOSING_S = 3.0  # yellow between the end of the recording and its beginning
AHEAD_M = 90.0  # how far beyond the light the exit lane of the KML is looked for

_Place: TypeAlias = tuple[str, int]  # edge, and lane of it
Run: TypeAlias = Sequence[tuple[float, str]]  # times in s, and SUMO's letter from then on


class _Movement(NamedTuple):
    source: FloatArray
    sink: FloatArray
    group: int


def recorded_programme(layout: NetLayout, road: Road, signals: Path) -> tuple[Programme | None, list[str]]:
    """Return the traffic light that replays a recording (None if it controls no link of the net), and notes.

    The recording begins at simulation time 0 and repeats.
    """
    runs = _read_phases(signals)
    beside = sorted(signals.parent.glob("*.kml"))
    if not beside:
        raise MapError(f"{signals}: no KML of the intersection beside it; put it into the same folder")
    moves = _read_movements(beside[0], road.origin)
    groups: dict[str, int] = {}
    shapes = {(edge.name, k): lane.shape for edge in layout.edges for k, lane in enumerate(edge.lanes)}
    leaving: dict[_Place, list[Connection]] = {}
    for c in layout.connections:
        leaving.setdefault((c.from_edge, c.from_lane), []).append(c)
    for c in layout.connections:
        near = [x for x in moves if x.group in runs and _begins(shapes[c.from_edge, c.from_lane], c, x)]
        ahead = _ahead(shapes, leaving, c) if near else []
        matching = [x.group for x in near if any(_leads_along(shape, x.sink) for shape in ahead)]
        if matching:
            groups[c.internal.name] = matching[0]
    if not groups:
        return None, [f"no connection of the net belongs to a movement of {signals.name}: no lights"]
    return _programme(layout, groups, runs), []


def lane_programme(
    layout: NetLayout, road: Road, states: Mapping[int, Run], name: str
) -> tuple[Programme | None, list[str]]:
    """Return the traffic light that replays recorded states of lanes, and notes.

    Args:
        states: (time in s from 0, letter) of each lane, in order of time; an empty letter if unknown: the
            last known state holds, before the first one that one.
        name: of the recording, for notes.
    """
    known = {i: [(time, letter) for time, letter in run if letter] for i, run in states.items()}
    runs = {i: _changes([(0.0, run[0][1]), *run]) for i, run in known.items() if run}
    groups: dict[str, int] = {}
    before = {i for i in runs if _lit_at_end(road, i)}
    for c in layout.connections:
        first, *others = c.lanelets
        lit = next((i for i in others if i in runs and i not in before), None)
        lit = first if others and first in runs and first in before else lit
        if lit is not None:
            groups[c.internal.name] = lit
    if not groups:
        return None, [f"no connection of the net belongs to a lane with known lights of {name}: no lights"]
    end, unknown = max(run[-1][0] for run in states.values() if run), len(states) - len(runs)
    notes = [f"{unknown} lights of {name} are never seen: not replayed"] if unknown else []
    return _programme(layout, groups, {**runs, -1: [(end, "")]}), notes


def _lit_at_end(road: Road, lane_id: int) -> bool:
    """Whether a lane's light stands at its end: some maps give it to the lane before the junction, others to
    the one across.
    """
    lane = road.lanes[lane_id]
    lines = [rule.stop_lines for rule in road.regulations if lane_id in rule.lanes and rule.stop_lines]
    if not lines:
        return not lane.conflicts
    s, _ = project(np.mean(lines[0][0], axis=0)[None], lane.centreline)
    return bool(s[0] > length_of(lane.centreline) / 2)


def _changes(run: Run) -> Run:
    return [x for k, x in enumerate(run) if not k or run[k - 1][1] != x[1]]


def _programme(layout: NetLayout, groups: dict[str, int], runs: dict[int, Run]) -> Programme:
    links = [c for c in layout.connections if c.internal.name in groups]
    phases = _phases(links, groups, runs)
    return Programme(name="tl_recorded", connections=tuple(links), phases=phases, programme=RECORDED)


def _no_tracks(paths: Sequence[Path], **_: Any) -> NoReturn:
    raise TrackError(f"{paths[0]}: signal phases, no tracks; give the recording of the vehicles")


def _read_phases(signals: Path) -> dict[int, Run]:
    groups: dict[int, list[tuple[int, str]]] = {}
    with refusing_damage(MapError, signals, "signal phases"), open_text(signals) as file:
        for row in csv.DictReader(file, restval=""):
            group, stamp, state = (row[key] for key in ("signal_group_id", "timestamp_ms", "movement_state"))
            if (letter := LETTERS.get(state.strip().upper())) is None:
                raise ValueError(f"movement_state is {state[:40]!r}")
            groups.setdefault(int(group), []).append((int(stamp), letter))
    if not groups:
        raise MapError(f"{signals}: no signal phases in it")
    runs: dict[int, Run] = {
        group: _changes([(stamp / 1000, letter) for stamp, letter in sorted(rows)])
        for group, rows in groups.items()
    }
    end = max(stamp for rows in groups.values() for stamp, _ in rows)
    runs[-1] = [(end / 1000, "")]
    return runs


def _read_movements(kml: Path, origin: tuple[float, float]) -> list[_Movement]:
    root = xml_root(kml, remedy="needs the KML of the intersection")
    lanes: dict[str, FloatArray] = {}
    connections: list[tuple[str, str, int]] = []
    for mark in root.findall(".//{*}Placemark"):
        line = mark.find("{*}LineString/{*}coordinates")
        data = {d.get("name"): (d.findtext("{*}value") or "") for d in mark.findall(".//{*}Data")}
        if line is None or "Source" not in data:
            continue
        source = data["Source"].strip()
        try:
            lanes[source] = _line(line.text or "", origin)
            connections += _links(source, data)
        except (IndexError, ValueError, RuntimeError) as error:  # the last one: no place on Earth
            raise MapError(f"{kml}: lane {source[:40]}: {one_line(error)}; needs degrees") from None
    usable = {name for name, lane in lanes.items() if len(lane) > 1}
    return [_Movement(lanes[a], lanes[b], group) for a, b, group in connections if {a, b} <= usable]


def _line(text: str, origin: tuple[float, float]) -> FloatArray:
    points = [triple.split(",") for triple in text.split()]
    degrees = np.array([[float(p[1]), float(p[0])] for p in points])
    if not np.isfinite(degrees).all():
        raise ValueError("a coordinate is not finite")
    return to_local(degrees, origin)


def _links(source: str, data: Mapping[str | None, str]) -> list[tuple[str, str, int]]:
    sinks, groups = (data.get(key, "").split(",") for key in ("Sink", "SignalGroup"))
    return [
        (source, sink.strip(), int(group))
        for sink, group in zip(sinks, groups, strict=False)
        if sink.strip() and group.strip()
    ]


def _ahead(
    shapes: Mapping[_Place, FloatArray], leaving: Mapping[_Place, list[Connection]], connection: Connection
) -> list[FloatArray]:
    signalled, stack, seen = [], [(connection, AHEAD_M)], {connection.internal.name}
    while stack:
        c, left = stack.pop()
        signalled.append(shape := shapes[c.to_edge, c.to_lane])
        left -= c.internal.length + length_of(shape)
        for following in leaving.get((c.to_edge, c.to_lane), ()):
            if left > 0 and following.internal.name not in seen:
                seen.add(following.internal.name)
                stack.append((following, left))
    return signalled


def _begins(before: FloatArray, connection: Connection, move: _Movement) -> bool:
    stop, leaving = move.source[0], turn(math.pi, heading(move.source, end=False, reach=10.0))
    (x, y), angle = stop - before[-1], heading(before, end=True)
    c, s = math.cos(angle), math.sin(angle)
    beside = abs(c * x + s * y) > NEAR_M or abs(c * y - s * x) > BESIDE_M
    return not (beside or abs(turn(leaving, connection.entry)) > ALIGNED)


def _leads_along(shape: FloatArray, sink: FloatArray) -> bool:
    probe = along(sink, min(5.0, length_of(sink)))
    reached, gap = project(probe[None], shape)
    aligned = abs(turn(heading(sink, end=False, reach=10.0), heading(shape, end=True))) < ALIGNED
    return bool(gap[0] < BESIDE_M and aligned and reached[0] > 0)


def _phases(
    links: Sequence[Connection], groups: dict[str, int], runs: dict[int, Run]
) -> tuple[tuple[float, str], ...]:
    used, end = {groups[c.internal.name] for c in links}, runs[-1][0][0]

    def state(start: float) -> str:
        return phase_state(links, {name: _letter(runs[group], start) for name, group in groups.items()})

    changes = sorted({0.0} | {t for group in used for t, _ in runs[group] if t < end})
    phases = [(round(stop - start, 3), state(start)) for start, stop in pairwise([*changes, end])]
    # The recording ends with some lights green that are red where it begins again: those turn yellow first.
    closing = "".join(
        "y" if last in "Gg" and first in "rsu" else "r" if last in "Gg" and first == "y" else last
        for last, first in zip(phases[-1][1], phases[0][1], strict=True)
    )
    return (*phases, (CLOSING_S, closing)) if "y" in closing else tuple(phases)


def _letter(run: Run, time: float) -> str:
    return next(letter for start, letter in reversed(run) if start <= time or start == run[0][0])


SPAT = Dataset(is_mine=is_spat, read=_no_tracks, signals=recorded_programme)
