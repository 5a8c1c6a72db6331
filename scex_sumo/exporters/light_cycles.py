"""Cycles of the traffic lights of a run, by lane of its road, read from its SUMO net."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import groupby
from typing import TypeAlias
from xml.etree.ElementTree import Element

import numpy as np

from scex_sumo.converters.net.sumo_net import SumoNet
from scex_sumo.converters.xml import net_root
from scex_sumo.road import Regulation, Road
from scex_sumo.scene import STEP_S


@dataclass(frozen=True, kw_only=True)
class LightCycle:
    """What a traffic light shows again and again.

    Attributes:
        phases: (steps, SUMO's letter of the state), e.g. ``(250, "G")``.
        offset: steps from the seed scene to the beginning of the first phase.
    """

    phases: tuple[tuple[int, str], ...]
    offset: int

    def at(self, step: int) -> str:
        """Return the letter that is shown at a step after the seed scene."""
        ends = np.cumsum([steps for steps, _ in self.phases])
        shown = np.searchsorted(ends, (step - self.offset) % ends[-1], side="right")
        return self.phases[int(shown)][1]


Cycles: TypeAlias = Mapping[int, Mapping[LightCycle, str]]


def light_cycles(net: SumoNet) -> dict[int, dict[LightCycle, str]]:
    """Return the cycles at each lane of the road, with SUMO's letters of their directions, e.g. ``sr``.

    The lanes behind a light are there as well as those before it. SUMO's time 0 is the seed scene.
    """
    root = net_root(net.path)
    logics = {logic.get("id", ""): logic for logic in root.iter("tlLogic")}  # SUMO takes the last one
    cycles: dict[int, dict[LightCycle, str]] = {}
    for link in root.iter("connection"):
        cycle = _cycle(logics.get(link.get("tl", "")), int(link.get("linkIndex", "-1")))
        if cycle is None:
            continue
        for name in (f"{link.get('from')}_{link.get('fromLane')}", link.get("via", "")):
            for lane in net.lanes.lanelets(name):
                turns = cycles.setdefault(lane, {})
                turns[cycle] = turns.get(cycle, "") + link.get("dir", "s")
    return cycles


def with_lights(road: Road, net: SumoNet) -> Road:
    """Return a road with a regulation for each lane before a light of its net that the map does not name."""
    named = {i for rule in road.regulations if rule.kind == "traffic_light" for i in rule.lanes}
    links = (link for link in net_root(net.path).iter("connection") if link.get("tl"))
    lanes = (net.lanes.lanelets(f"{link.get('from')}_{link.get('fromLane')}")[-1:] for link in links)
    unnamed = sorted({i for last in lanes for i in last if i in road.lanes} - named)
    first = max((rule.element_id for rule in road.regulations), default=0) + 1
    lights = [
        Regulation(element_id=n, kind="traffic_light", lanes=(i,)) for n, i in enumerate(unnamed, first)
    ]
    return replace(road, regulations=(*road.regulations, *lights)) if lights else road


def _cycle(logic: Element | None, link: int) -> LightCycle | None:
    phases = [] if logic is None else list(logic.iter("phase"))
    if logic is None or not phases or not all(0 <= link < len(p.get("state", "")) for p in phases):
        return None
    ends = np.cumsum([float(phase.get("duration", "0")) for phase in phases]) / STEP_S
    steps = np.diff(ends.round().astype(int), prepend=0).tolist()
    letters = [phase.get("state", "")[link] for phase in phases]
    shown = [(n, letter) for n, letter in zip(steps, letters, strict=True) if n > 0]
    together = ((letter, list(same)) for letter, same in groupby(shown, key=lambda phase: phase[1]))
    runs = tuple((sum(n for n, _ in same), letter) for letter, same in together)
    return LightCycle(phases=runs, offset=round(float(logic.get("offset", "0")) / STEP_S)) if runs else None
