"""Links of a SUMO net through its junctions, with their right of way and their lights."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.links import links_of
from scex_sumo.converters.net.sumo_net import RECORDED, LaneTable, points_of
from scex_sumo.geometry.polylines import heading, without_repeats
from scex_sumo.road_rules import Passage, Signal
from scex_sumo.scene import STEP_S


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


def junction_links(root: Element) -> list[Link]:
    """Return the links of a net that lead through junctions."""
    shapes = {lane.get("id", ""): points_of(lane.get("shape", "")) for lane in root.iter("lane")}
    responses = {
        (junction.get("id"), request.get("index")): request.get("response", "")[::-1]
        for junction in root.iter("junction")
        for request in junction.iter("request")
    }
    links = []
    for link in links_of(root):
        points = [shapes[lane] for lane in link.via if lane in shapes]
        line = without_repeats(np.vstack(points)) if points else np.empty((0, 2))
        if not link.junction or len(line) < 2:
            continue
        response = responses.get((link.junction, str(link.row)), "")
        yields = frozenset(row for row, bit in enumerate(response) if bit == "1")
        light = (link.signal, link.signal_index) if link.signal else None
        lanes = (link.from_lane, *link.via, link.to_lane)
        links.append(Link(line, lanes, link.junction, link.row, yields, link.state, light))
    return links


def by_junction(links: Sequence[Link]) -> dict[str, list[Link]]:
    """Return the links of each junction."""
    links_at: dict[str, list[Link]] = {}
    for link in links:
        links_at.setdefault(link.junction, []).append(link)
    return links_at


def signals_of_links(
    root: Element, links: Sequence[Link], *, known: bool
) -> tuple[dict[tuple[str, int], Signal], list[str]]:
    """Return the signal of each (light, link index), and notes."""
    notes: list[str] = []
    programmes = {logic.get("id", ""): logic for logic in root.iter("tlLogic")}  # SUMO takes the last one
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


def passages_of(
    links: Sequence[Link], first: int, signals: Mapping[tuple[str, int], Signal], lanes: LaneTable
) -> Iterator[Passage]:
    """Yield the passage of each link of a junction; ``first``: the number of the first one."""
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
