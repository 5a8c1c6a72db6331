"""Lights of a net as bars at the ends of its lanes, with what they show in each step of a future."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.converters.net.sumo_net import points_of
from scex_sumo.converters.xml import is_left_hand, net_root
from scex_sumo.rules.links import junction_links, signals_of_links
from scex_sumo.scene import STEP_S

LANE_M = 3.2  # SUMO's default width


class LightBar(NamedTuple):
    """Bar of a light: ends (2, 2) in m, and SUMO's letter at the seed moment and after each step."""

    ends: FloatArray
    letters: str


def light_bars(net: Path, steps: int, *, known: bool) -> list[LightBar]:
    """Return the bars of the lights of a net; those of one lane stand side by side.

    ``known``: whether phases count that no recording gave, as those of a SUMO simulation do.
    """
    if not net.is_file():
        return []
    root = net_root(net)
    lanes = {lane.get("id", ""): lane for lane in root.iter("lane")}
    links = [link for link in junction_links(root) if link.light is not None]
    signals, _ = signals_of_links(root, links, known=known)
    shown: dict[str, dict[int, str]] = defaultdict(dict)
    for link in links:
        if link.light is not None and link.light in signals and signals[link.light].letters:
            letters = "".join(signals[link.light].at(STEP_S * step)[0] for step in range(steps + 1))
            if letters not in shown[link.lanes[0]].values():
                shown[link.lanes[0]][link.light[1]] = letters
    bars = []
    for name, of in shown.items():
        before, end = points_of(lanes[name].get("shape", ""))[-2:]
        along, width = (end - before) / np.hypot(*(end - before)), float(lanes[name].get("width", LANE_M))
        # Links of a lane are numbered from the kerb.
        right = np.array([along[1], -along[0]]) * (-1.0 if is_left_hand(root) else 1.0)
        edges = width * (0.5 - np.arange(len(of) + 1) / len(of))
        for k, index in enumerate(sorted(of)):
            bars.append(LightBar(end + edges[k : k + 2, None] * right, of[index]))
    return bars
