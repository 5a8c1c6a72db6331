"""Phases of a running simulation's traffic lights, and a net that begins with them."""

from __future__ import annotations

import bisect
import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from scex_sumo.base.errors import listed
from scex_sumo.converters.net.allowed import SIMULATED
from scex_sumo.converters.xml import net_root
from scex_sumo.formats.sumo.imported import kept_net
from scex_sumo.road import Road
from scex_sumo.scene import HISTORY_STEPS, STEP_S

_HELD_S = 1000.0
_FIXED = ""
_FOLLOWED = "traffic lights that do in each future what they do in the simulation, whatever the traffic"
_LONGEST = "traffic lights, actuated in the simulation, whose phases have their longest durations"
_STILL = "traffic lights that keep their present state in the futures"


@dataclass(frozen=True, kw_only=True)
class Light:
    """State of a traffic light, which vehicles see in the steps that begin at ``since_s`` or later."""

    since_s: float
    programme: str
    phase: int
    state: str


@dataclass(frozen=True, kw_only=True)
class Programme:
    """Programme of a traffic light: state, longest duration, s, and following phase of each phase.

    ``fixed``: whether traffic does not shorten the phases.
    """

    fixed: bool
    phases: tuple[tuple[str, float, int], ...]


def with_lights(
    road: Road | None,
    recorded: Mapping[str, Sequence[Light]],
    programmes: Mapping[tuple[str, str], Programme],
    time_s: float,
    end_s: float,
    saved: Sequence[ElementTree.Element] = (),
) -> tuple[Road | None, list[str]]:
    """Return a road whose net begins with the lights as they are at a time, and notes on the lights.

    Args:
        recorded: changes of each light, in order of time, of which those before ``end_s`` count.
        programmes: by light and name.
        saved: of SUMO's saved state at the time; the net keeps them, with its own programmes, for exports.
    """
    if road is None or road.net is None or not recorded:
        return road, []
    lights: dict[str, ElementTree.Element] = {}
    groups: dict[str, list[str]] = {}
    for name, changes in recorded.items():
        known = {programme: logic for (light, programme), logic in programmes.items() if light == name}
        phases, group = _phases_from(changes, known, time_s, end_s)
        groups.setdefault(group, []).append(name)
        # A future begins at 0.1 s of its simulation.
        light = ElementTree.Element("tlLogic", id=name, type="static", programID="0", offset=str(STEP_S))
        for state, duration in phases:
            if duration > 5e-4:
                ElementTree.SubElement(light, "phase", duration=f"{duration:.3f}", state=state)
        lights[name] = light
    given = road.net
    made_of = b"".join(ElementTree.tostring(light) for light in (*lights.values(), *saved))
    net = kept_net(given, given.read_bytes() + made_of, lambda: _relit(given, lights, saved))
    notes = [f"{said}: {listed(groups[said])}" for said in (_FOLLOWED, _LONGEST, _STILL) if said in groups]
    return dataclasses.replace(road, net=net), notes


def _phases_from(
    changes: Sequence[Light], known: Mapping[str, Programme], time_s: float, end_s: float
) -> tuple[list[tuple[str, float]], str]:
    """Return state and duration, s, of the phases of a light from a time on, and the note they need.

    A fixed programme goes on. Others follow the recording until ``end_s``, then their longest durations.
    """
    changes = [change for change in changes if change.since_s < end_s] or changes[:1]
    first = max(bisect.bisect_left(changes, time_s - 1e-6, key=lambda change: change.since_s) - 1, 0)
    now, last = changes[first], changes[-1]
    ends = [max(change.since_s, time_s) for change in changes[first + 1 :]]
    seen = [(a.state, d) for a, d in zip(changes[first:], np.diff([time_s, *ends, end_s]), strict=True)]
    logic = known.get(now.programme)
    if logic is not None and logic.fixed:
        phases = _going_on(logic, now, time_s)
        if _begins_with(phases, seen):
            return [*phases, (now.state, max(time_s - now.since_s, STEP_S))], _FIXED
    at_s, logic = max(last.since_s, time_s), known.get(last.programme)
    before = now.state, HISTORY_STEPS * STEP_S  # which a replay shows
    phases = [*seen[:-1], *_going_on(logic, last, at_s, at_least_s=end_s - at_s), before]
    return phases, _FOLLOWED if end_s - time_s > STEP_S else _STILL if logic is None else _LONGEST


def _begins_with(phases: Sequence[tuple[str, float]], seen: Sequence[tuple[str, float]]) -> bool:
    """Whether phases begin with the recorded ones, whose last one may be cut short by the recording's end."""
    *whole, cut = zip(phases, seen, strict=False)
    return (
        len(phases) >= len(seen)
        and all(a == b for (a, _), (b, _) in [*whole, cut])
        and all(abs(c - d) < STEP_S / 2 for (_, c), (_, d) in whole)
        and cut[0][1] > cut[1][1] - STEP_S / 2
    )


def _going_on(
    logic: Programme | None, now: Light, time_s: float, *, at_least_s: float = 0.0
) -> list[tuple[str, float]]:
    """Return state and duration, s, of each phase of a programme once, from a state at a time on."""
    if logic is None or now.phase >= len(logic.phases):
        return [(now.state, _HELD_S)]
    _, duration, after = logic.phases[now.phase]
    phases = [(now.state, max(duration - (time_s - now.since_s), at_least_s, 0.0))]
    while after != now.phase and len(phases) < len(logic.phases):
        state, duration, following = logic.phases[after]
        phases.append((state, duration))
        after = following
    return phases


def _relit(
    net: Path, lights: Mapping[str, ElementTree.Element], saved: Sequence[ElementTree.Element]
) -> bytes:
    root = net_root(net)
    own = [light for light in root.iter("tlLogic") if light.get("id", "") in lights]
    there = {(light.get("id"), light.get("programID")) for light in own}
    elsewhere = {s.get("id") for s in saved if (s.get("id"), s.get("programID")) not in there}
    kept: dict[str, str] = {}
    for light in (*own, *saved):
        light.tail, name = None, light.get("id", "")
        if name in lights and name not in elsewhere:
            kept[name] = kept.get(name, "") + ElementTree.tostring(light, encoding="unicode")
    for name, programmes in kept.items():
        ElementTree.SubElement(lights[name], "param", key=SIMULATED, value=programmes)
    others = [e for e in root if e.tag != "tlLogic" or e.get("id", "") not in lights]
    after = next((k for k, element in enumerate(others) if element.tag == "junction"), len(others))
    root[:] = [*others[:after], *lights.values(), *others[after:]]  # before the junctions, as SUMO has them
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))
