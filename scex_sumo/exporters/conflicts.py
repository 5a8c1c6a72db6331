"""Conflicts and collisions of futures in the formats of SUMO's SSM device and collision output.

Names and times are those of the futures's floating car data; vehicles have their track ids.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np
import shapely

from scex_sumo.evaluation.sources import read_source
from scex_sumo.evaluation.tables import recording_table
from scex_sumo.exporters.request import Request
from scex_sumo.geometry.polylines import arc_lengths, nearest
from scex_sumo.metrics.events import EVENTS
from scex_sumo.scene import LOGGED_HISTORY, STEP_S
from scex_sumo.views.fcd import LaneFinder

# The device's codes of encounters: ego follows, ego leads, both have left the conflict area, collision.
FOLLOWER, LEADER, LEFT, COLLISION = 2, 3, 17, 111
CONFLICTS: Final = tuple(
    replace(EVENTS[name], threshold=limit) for name, limit in (("ttc", 3.0), ("drac", 3.0), ("pet", 2.0))
)
"""Events that make a conflict, with SUMO's own thresholds, which belong to it."""
_NOTHING = {name: "NA" for name in ("time", "position", "type", "value", "speed")}
_TYPES = {"rear-end": "collision", "head-on": "frontal"}

Row = Mapping[str, Any]


class _Future:
    def __init__(self, request: Request, future: int) -> None:
        scene, seed_s = request.scene, LOGGED_HISTORY * STEP_S
        self.states, self.length = request.run.states(future), scene.length
        self.index = {int(track): v for v, track in enumerate(scene.track_ids)}
        self.names, self.types = (dict(zip(self.index, x, strict=True)) for x in (scene.names, scene.types))
        rows: Sequence[Row] = request.run.collisions.to_pylist()
        mine = (collision for collision in rows if collision["future"] == future)
        self.collisions = [{**collision, "time_s": collision["time_s"] + seed_s} for collision in mine]

    def at(self, track: int, time_s: float) -> tuple[float, float, float, float]:
        """Return x, y, heading and speed of a vehicle at a time of the floating car data, s."""
        k, s = round(time_s / STEP_S) - 1, self.states
        here = self.index[track], min(k, s.shape[1] - 1)
        return float(s.x[here]), float(s.y[here]), float(s.heading[here]), float(s.speed[here])

    def end(self, track: int, time_s: float, side: int) -> str:
        """Return the middle of a bumper: 1 for the front, -1 for the rear."""
        x, y, heading, _ = self.at(track, time_s)
        reach = side * self.length[self.index[track]] / 2
        return f"{x + reach * np.cos(heading):.2f},{y + reach * np.sin(heading):.2f}"


def write_ssm(request: Request) -> list[Path]:
    """Write the conflicts of each future as SUMO's SSM device does: TTC, DRAC and PET of pairs of vehicles.

    A conflict has a TTC of at most 3 s, a DRAC of at least 3 m/s², a PET of at most 2 s, or a collision. Each
    pair is written once; the ego follows, or comes second.
    """
    table, history = read_source(request.run.folder)
    measures = {"level": "pair", "metrics": ("ttc_path", "drac", "pet"), "history": history}

    def lines(future: int) -> Iterator[str]:
        case = table.case(table.cases.index(str(future)))
        rows = recording_table(case, **measures).to_pylist()  # type: ignore[arg-type]
        limits = ", ".join(event.words.replace("<", "<=").replace(">", ">=") for event in CONFLICTS)
        yield f"<!-- {limits} -->\n<SSMLog>\n"
        yield from _conflicts(_Future(request, future), rows)
        yield "</SSMLog>\n"

    return request.write_each(".ssm.xml", lambda future: _xml(lines(future)))


def write_collisions(request: Request) -> list[Path]:
    """Write the collisions of each future as SUMO's ``collision-output``."""
    lanes = LaneFinder(request.run.net.path)

    def lines(future: int) -> Iterator[str]:
        schema = "http://sumo.dlr.de/xsd/collision_file.xsd"
        yield '<collisions xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
        yield f'xsi:noNamespaceSchemaLocation="{schema}">\n'
        here = _Future(request, future)
        for collision in here.collisions:
            yield _element("    ", "collision", _collision(here, collision, lanes))
        yield "</collisions>\n"

    return request.write_each(".collisions.xml", lambda future: _xml(lines(future)))


def _xml(lines: Iterable[str]) -> bytes:
    return "".join(('<?xml version="1.0" encoding="UTF-8"?>\n', *lines)).encode()


def _conflicts(future: _Future, measures: Sequence[Row]) -> Iterator[str]:
    hits = {frozenset((hit["track_id"], hit["other_id"])): hit for hit in future.collisions}
    pairs: dict[frozenset[int], list[Row]] = {pair: [] for pair in hits}
    for measure in measures:
        if np.isfinite(measure["value"]) and not (measure["metric"] == "drac" and measure["value"] <= 0):
            pairs.setdefault(frozenset((measure["track_id"], measure["other_id"])), []).append(measure)
    texts = []
    for pair, of_pair in pairs.items():
        hit = hits.get(pair)
        until_ms = np.inf if hit is None else 1000 * hit["time_s"]
        before = [measure for measure in of_pair if measure["timestamp_ms"] < until_ms]
        worst: list[Row | None] = []
        beyond = hit is not None
        for event in CONFLICTS:
            own = (measure for measure in before if measure["metric"].removesuffix("_path") == event.name)
            most = max(own, key=lambda measure: event.side * measure["value"], default=None)
            beyond |= most is not None and event.side * most["value"] >= event.side * event.threshold
            worst.append(most)
        if beyond:
            texts.append(_conflict(future, before, worst, hit))
    yield from (text for _, text in sorted(texts))


def _conflict(
    future: _Future, measures: Sequence[Row], worst: Sequence[Row | None], hit: Row | None
) -> tuple[float, str]:
    """Return begin and text of the conflict of a pair; ``worst`` are its measures of the `CONFLICTS`."""
    ttc, drac, pet = worst
    passing = None if pet is None else _passing(future, pet["track_id"], pet["other_id"])
    leads = next(event for event in (ttc, drac, pet, hit) if event is not None)
    ego, foe = leads["track_id"], leads["other_id"]
    if leads is pet and passing is not None:
        ego, foe, _, _ = passing
    times = [measure["timestamp_ms"] / 1000 for measure in measures]
    times += [] if hit is None else [hit["time_s"]]
    begin, end = min(times), max([*times, *([] if passing is None else passing[2:3])])
    lines = {"minTTC": _following(future, ego, ttc), "maxDRAC": _following(future, ego, drac)}
    if hit is not None:
        place, speed = f"{hit['x']:.2f},{hit['y']:.2f}", future.at(ego, hit["time_s"])[3]
        lines["minTTC"] = _measure(hit["time_s"], place, COLLISION, 0.0, speed)
    lines["PET"] = _NOTHING
    if pet is not None and passing is not None:
        _, _, time_s, place = passing
        lines["PET"] = _measure(time_s, place, LEFT, pet["value"], future.at(ego, time_s)[3])
    head = {"begin": f"{begin:.2f}", "end": f"{end:.2f}", "ego": future.names[ego], "foe": future.names[foe]}
    inside = "".join(_element("        ", tag, values) for tag, values in lines.items())
    return begin, _element("    ", "conflict", head, inside)


def _following(future: _Future, ego: int, measure: Row | None) -> Mapping[str, str]:
    if measure is None:
        return _NOTHING
    time_s, follows = measure["timestamp_ms"] / 1000, measure["track_id"] == ego
    place, speed = future.end(measure["other_id"], time_s, -1), future.at(ego, time_s)[3]
    return _measure(time_s, place, FOLLOWER if follows else LEADER, measure["value"], speed)


def _measure(time_s: float, place: str, kind: int, value: float, speed: float) -> dict[str, str]:
    texts = (f"{time_s:.2f}", place, str(kind), f"{value:.2f}", f"{speed:.2f}")
    return dict(zip(_NOTHING, texts, strict=True))


def _passing(future: _Future, track_id: int, other_id: int) -> tuple[int, int, float, str] | None:
    """Return the vehicle that crosses second, the first one, when the second one is there, and where."""
    lines = {}
    for vehicle in (track_id, other_id):
        states = future.states[future.index[vehicle], LOGGED_HISTORY - 1 :]
        line = np.stack([states.x, states.y], -1)
        lines[vehicle] = line[np.isfinite(states.x)]  # until the vehicle arrives
    points = shapely.get_coordinates(shapely.intersection(*map(shapely.LineString, lines.values())))
    if not len(points):
        return None
    (x, y), reached = points[0].tolist(), {}
    for vehicle, line in lines.items():
        front = max(nearest(line, x, y) - future.length[future.index[vehicle]] / 2, 0.0)
        reached[vehicle] = (LOGGED_HISTORY + float(np.searchsorted(arc_lengths(line), front))) * STEP_S
    first, second = sorted(reached, key=lambda vehicle: reached[vehicle])
    return second, first, reached[second], f"{x:.2f},{y:.2f}"


def _collision(future: _Future, collision: Row, lanes: LaneFinder) -> dict[str, str]:
    collider, victim, time_s = collision["track_id"], collision["other_id"], collision["time_s"]
    if collision["side"] != "front" and collision["other_side"] == "front":
        collider, victim = victim, collider
    x, y, heading, _ = (np.array([value]) for value in future.at(collider, time_s))
    (lane,), (along,) = lanes.find(x, y, heading, np.array([False]))
    kind = _TYPES.get(collision["kind"], "junction" if lane.startswith(":") else "side")
    values = {"time": f"{time_s:.2f}", "type": kind, "lane": lane, "pos": f"{along:.2f}"}
    both = {"collider": collider, "victim": victim}
    values |= {role: future.names[track] for role, track in both.items()}
    values |= {f"{role}Type": future.types[track] for role, track in both.items()}
    values |= {f"{role}Speed": f"{future.at(track, time_s)[3]:.2f}" for role, track in both.items()}
    for name, side in (("Front", 1), ("Back", -1)):
        values |= {f"{role}{name}": future.end(track, time_s, side) for role, track in both.items()}
    return values


def _element(indent: str, tag: str, values: Mapping[str, str], inside: str = "") -> str:
    words = "".join(f" {name}={quoteattr(value)}" for name, value in values.items())
    return f"{indent}<{tag}{words}>\n{inside}{indent}</{tag}>\n" if inside else f"{indent}<{tag}{words}/>\n"
