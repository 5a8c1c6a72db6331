"""Rules of the road, read from the SUMO net of a run: what SUMO's drivers see, ours see too."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.files import TemporaryFolder
from scex_sumo.base.owned import owner_cache
from scex_sumo.converters.net.sumo_net import RECORDED, LaneTable, SumoNet, points_of
from scex_sumo.converters.registries import signals_of
from scex_sumo.converters.xml import net_root, unpacked
from scex_sumo.geometry.polylines import heading, turn, without_repeats
from scex_sumo.lanelet2sumo.convert import converted
from scex_sumo.road import Road
from scex_sumo.road_rules import Passage, Rules, Signal
from scex_sumo.rules.passages import NO_SIGN, STANDS_MPS
from scex_sumo.scene import STEP_S, SeedScene

BOTH_WAYS = "wZ="  # link states of which two may give way to each other
OPPOSED_RAD, TURNS_RAD = np.deg2rad(135.0), np.deg2rad(30.0)
MIN_APPROACHES = 3  # edges that lead to the junction: two merge
MIN_QUEUES, MIN_QUEUED = 2, 2  # lanes with a queue; vehicles in it
FIRST_M, NEXT_M = 15.0, 15.0  # from the first one to the junction, and from front to front
ACROSS_M, ALONG_COS = 1.6, 0.9  # of a vehicle from the middle of its lane, of its heading
LINE_M = 0.5, 3.0  # of a stop line: before the first one, and its length


def with_rules(scene: SeedScene, net: SumoNet) -> tuple[SeedScene, tuple[str, ...]]:
    """Return a scene with the rules of its road (None if it has none), and notes, by the road's net."""
    file = _NetFile(path=net.path, digest=hashlib.sha256(unpacked(net.path)).hexdigest())
    if scene.rules is not None and scene.rules.net == file.digest:
        return scene, scene.rules.notes
    found = _rules_of(scene, net.lanes, file)
    rules = found if found.passages or found.crosswalks else None
    return scene if scene.rules is rules else _ruled(scene, rules), found.notes


@dataclass(frozen=True)
class _NetFile:
    """File of a net; one with the same content is equal."""

    path: Path = field(compare=False)
    digest: str


@owner_cache
def _ruled(scene: SeedScene, rules: Rules | None) -> SeedScene:
    return replace(scene, rules=rules)


@owner_cache
def _rules_of(scene: SeedScene, lanes: LaneTable, net: _NetFile) -> Rules:
    """Return the rules of a scene's road, with recorded lights."""
    road = scene.road
    assert road is not None
    signals = signals_of(scene)
    if signals is None:
        rules = _rules_of_road(road, lanes, net)
        known = road.regulations or road.net
        return rules if known else _with_apparent_lights(scene, road, lanes, net, rules)
    root = net_root(net.path)
    if not _is_recorded(root):
        with TemporaryFolder() as folder:
            path = Path(folder) / "lit.net.xml"
            lanes = converted(road, path, signals=signals, time_s=scene.time_s).lanes
            root = net_root(path)
    rules = read_rules(root, lanes, road)
    recorded = (f"lights as recorded in {signals.name}",) if _is_recorded(root) else ()
    return replace(rules, notes=(*recorded, *rules.notes), net=net.digest)


@owner_cache
def _rules_of_road(road: Road, lanes: LaneTable, net: _NetFile) -> Rules:
    """Return the rules of a road without recorded lights, once for all its moments."""
    return replace(read_rules(net_root(net.path), lanes, road), net=net.digest)


def _with_apparent_lights(
    scene: SeedScene, road: Road, lanes: LaneTable, net: _NetFile, rules: Rules
) -> Rules:
    """Add the lights that a road without regulations apparently has; elsewhere turns across traffic wait."""
    passages, stops, notes = list(rules.passages), list(rules.stop_lines), list(rules.notes)
    signals: dict[tuple[str, int], Signal] = {}
    for junction, links in _links_by_junction(road, net).items():
        lit, states, lines = apparent_lights(scene, links)
        if lit:
            signals |= states
            passages += _passages(lit, len(passages), signals, lanes)
            stops += lines
            why = f"vehicles queue on {len(lines)} lanes before it"
            notes.append(f"junction {junction} apparently has lights, whose states are inferred: {why}")
        else:
            turns = turns_that_wait(links)
            waits = any(link.yields for link in turns)
            passages += _passages(turns, len(passages), {}, lanes) if waits else ()
    return replace(
        rules,
        passages=tuple(passages),
        signals=tuple(signals.values()),
        stop_lines=tuple(stops),
        notes=tuple(notes),
    )


@owner_cache
def _links_by_junction(road: Road, net: _NetFile) -> dict[str, list[Link]]:
    """Return the links of each junction of a road's net, once for all its moments."""
    return dict(sorted(_by_junction(links_of(net_root(net.path))).items()))


def _by_junction(links: Sequence[Link]) -> dict[str, list[Link]]:
    found: dict[str, list[Link]] = {}
    for link in links:
        found.setdefault(link.junction, []).append(link)
    return found


def _is_recorded(root: Element) -> bool:
    return any(logic.get("programID") == RECORDED for logic in root.iter("tlLogic"))


def read_rules(root: Element, lanes: LaneTable, road: Road) -> Rules:
    """Return the rules of a net, with notes on what contradicts itself, where nothing is obeyed.

    Lights whose phases are invented, also by netconvert for OpenStreetMap, are unknown.
    """
    links = links_of(root)
    signals, notes = signals_of_links(root, links, known=road.net is not None and road.phases)
    by_junction, passages = _by_junction(links), list[Passage]()
    for junction in root.iter("junction"):
        mine = by_junction.get(junction.get("id", ""), [])
        if any(link.light is not None and link.light not in signals for link in mine):
            continue
        lit = any(link.light is not None for link in mine)
        if not lit and junction.get("type", "").startswith("traffic_light"):
            continue  # its lights were left out
        # Without regulations the net's right of way is guessed.
        if lit or ((road.regulations or road.net) and any(link.yields for link in mine)):
            if twice := _contradiction(mine):
                notes.append(f"junction {junction.get('id')}: {twice} give way to each other; no rules there")
                continue
            passages += _passages(mine, len(passages), signals, lanes)
    crosswalks = tuple(area.outline for area in road.areas if area.kind == "crosswalk")
    lines = tuple(line for rule in road.regulations for line in rule.stop_lines)
    states = tuple(signals.values())
    if unknown := sum(p.signal >= 0 and not states[p.signal].letters for p in passages):
        notes.append(f"lights of {unknown} passages are unknown: inferred from vehicles that stand or drive")
    return Rules(
        passages=tuple(passages), signals=states, stop_lines=lines, crosswalks=crosswalks, notes=tuple(notes)
    )


def links_of(root: Element) -> list[Link]:
    """Return the links of a net that lead through junctions."""
    shapes = {lane.get("id", ""): points_of(lane.get("shape", "")) for lane in root.iter("lane")}
    following = {
        f"{c.get('from')}_{c.get('fromLane')}": c.get("via")
        for c in root.iter("connection")
        if c.get("from", "").startswith(":")
    }
    rows, links = dict(_rows(root)), []
    for c in root.iter("connection"):
        if c.get("from", "").startswith(":") or not c.get("via"):
            continue
        chain: list[str] = []
        lane = c.get("via")
        while lane and lane in shapes and lane not in chain:
            chain.append(lane)
            lane = following.get(lane)
        request = next((rows[lane] for lane in chain if lane in rows), None)
        line = without_repeats(np.vstack([shapes[lane] for lane in chain])) if chain else np.empty((0, 2))
        if request is None or len(line) < 2:
            continue
        light = (c.get("tl", ""), int(c.get("linkIndex", -1))) if c.get("tl") else None
        ends = (f"{c.get('from')}_{c.get('fromLane')}", f"{c.get('to')}_{c.get('toLane')}")
        links.append(Link(line, (ends[0], *chain, ends[1]), *request, c.get("state", ""), light))
    return links


def _rows(root: Element) -> Iterator[tuple[str, tuple[str, int, frozenset[int]]]]:
    """Yield each internal lane with its junction, its row, and the rows to which it gives way."""
    for junction in root.iter("junction"):
        if junction.get("type") != "internal":
            name, lanes = junction.get("id", ""), junction.get("intLanes", "").split()
            bits = {r.get("index"): r.get("response", "")[::-1] for r in junction.iter("request")}
            for row, lane in enumerate(lanes):
                yields = (k for k, bit in enumerate(bits.get(str(row), "")) if bit == "1")
                yield lane, (name, row, frozenset(yields))


def signals_of_links(
    root: Element, links: Sequence[Link], *, known: bool
) -> tuple[dict[tuple[str, int], Signal], list[str]]:
    """Return the signal of each (light, link index), and notes."""
    notes: list[str] = []
    programmes: dict[str, Element] = {}
    for programme in root.iter("tlLogic"):
        programmes.setdefault(programme.get("id", ""), programme)
    used: dict[str, set[int]] = {}
    for link in links:
        if link.light is not None:
            used.setdefault(link.light[0], set()).add(link.light[1])
    signals: dict[tuple[str, int], Signal] = {}
    for name, indices in used.items():
        logic = programmes.get(name, Element("tlLogic"))
        phases = [(float(p.get("duration", 0)), p.get("state", "")) for p in logic.iter("phase")]
        phases = [phase for phase in phases if phase[0] > 0]
        fits = bool(phases) and all(len(state) > max(indices) for _, state in phases)
        if not fits:
            notes.append(f"traffic light {name}: its phases do not fit its {len(indices)} links; not obeyed")
        offset = float(logic.get("offset", 0) or 0)
        for index in indices:
            if fits and (known or logic.get("programID") == RECORDED):
                letters = "".join(state[index] for _, state in phases)
                ends = np.cumsum([duration for duration, _ in phases])
                # A future begins at 0.1 s of its simulation.
                signals[name, index] = Signal(ends_s=ends, letters=letters, start_s=STEP_S - offset)
            elif fits:
                signals[name, index] = Signal()
    return signals, notes


def _contradiction(links: Sequence[Link]) -> str:
    """Name two links without all-way stop, zipper or right before left that give way to each other."""
    by_row = {link.row: link for link in links}
    for link in links:
        for row in link.yields:
            other = by_row.get(row)
            both = other is not None and link.row in other.yields and link.light is None
            if other is not None and both and not {link.state, other.state} & set(BOTH_WAYS):
                return " and ".join(f"{one.lanes[0]} to {one.lanes[-1]}" for one in (link, other))
    return ""


def _passages(
    links: Sequence[Link], first: int, signals: Mapping[tuple[str, int], Signal], lanes: LaneTable
) -> Iterator[Passage]:
    places = {link.row: first + k for k, link in enumerate(links)}
    numbers = {key: k for k, key in enumerate(signals)}
    for link in links:
        under = dict.fromkeys(lanelet for lane in link.lanes for lanelet in lanes.lanelets(lane))
        yield Passage(
            line=link.line,
            lanes=tuple(under),
            state=link.state,
            signal=-1 if link.light is None else numbers.get(link.light, -1),
            yields_to=tuple(places[row] for row in sorted(link.yields) if row in places),
        )


@dataclass(frozen=True, eq=False)
class Link:
    """Link of a net from a lane to a lane, with its light (light, index) and the rows to which it yields."""

    line: FloatArray
    lanes: tuple[str, ...]
    junction: str
    row: int
    yields: frozenset[int]
    state: str
    light: tuple[str, int] | None

    @property
    def headings(self) -> tuple[float, float]:
        """Headings at its beginning and its end, rad."""
        return heading(self.line, end=False), heading(self.line, end=True)


def apparent_lights(
    scene: SeedScene, links: Sequence[Link]
) -> tuple[list[Link], dict[tuple[str, int], Signal], list[FloatArray]]:
    """Return the links of a junction from lanes with queues, lights of unknown state, and stop lines.

    Lanes of one edge share a light. Without queues on several lanes there are none.
    """
    lanes = sorted({link.lanes[0] for link in links})
    if len({lane.rpartition("_")[0] for lane in lanes}) < MIN_APPROACHES:
        return [], {}, []
    begins = {link.lanes[0]: link.line[:2] for link in links}
    stops = {lane: line for lane in lanes if (line := _stop_line(scene, begins[lane])) is not None}
    if len(stops) < MIN_QUEUES:
        return [], {}, []
    edges = sorted({lane.rpartition("_")[0] for lane in stops})
    lights = {lane: (links[0].junction, edges.index(lane.rpartition("_")[0])) for lane in stops}
    lit = [replace(link, light=lights[link.lanes[0]]) for link in links if link.lanes[0] in stops]
    return lit, {light: Signal() for light in lights.values()}, [*stops.values()]


def _stop_line(scene: SeedScene, begin: FloatArray) -> FloatArray | None:
    """Return the stop line (2, 2) of a queue before a way (2, 2), m; None without one."""
    now, along = scene.now, (begin[1] - begin[0]) / np.hypot(*(begin[1] - begin[0]))
    half, across = scene.length / 2, np.array([-along[1], along[0]])
    x, y = now.x + half * np.cos(now.heading) - begin[0, 0], now.y + half * np.sin(now.heading) - begin[0, 1]
    way, aside = -(along[0] * x + along[1] * y), np.abs(across[0] * x + across[1] * y)
    aligned = np.cos(now.heading) * along[0] + np.sin(now.heading) * along[1] > ALONG_COS
    there = (now.speed < STANDS_MPS) & aligned & (aside < ACROSS_M) & (way > -LINE_M[0])
    queue = np.sort(way[there])
    if len(queue) < MIN_QUEUED or queue[0] > FIRST_M or queue[1] - queue[0] > NEXT_M:
        return None
    place = begin[0] - max(queue[0] - LINE_M[0], 0.0) * along
    return np.stack([place - LINE_M[1] / 2 * across, place + LINE_M[1] / 2 * across])


def turns_that_wait(links: Sequence[Link]) -> list[Link]:
    """Return the links of a junction without rules, of which those across oncoming traffic yield to it."""
    ways = {link.row: link.headings for link in links}  # not of crosswalks, to which links yield, too

    def comes(row: int, link: Link) -> bool:
        (begins, ends), (mine, my_end) = ways[row], link.headings
        opposed = abs(turn(begins, mine)) > OPPOSED_RAD
        return bool(opposed and abs(turn(begins, ends)) < TURNS_RAD < abs(turn(mine, my_end)))

    oncoming = [frozenset(row for row in link.yields & ways.keys() if comes(row, link)) for link in links]
    return [replace(link, state=NO_SIGN, yields=rows) for link, rows in zip(links, oncoming, strict=True)]
