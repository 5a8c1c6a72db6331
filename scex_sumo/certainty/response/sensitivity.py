"""Sensitivity of the critical responses of one pair to errors of its boxes and headings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from scex_sumo.certainty.response.answer import decisive_rows
from scex_sumo.certainty.response.decision import PairResponse, pair_responses
from scex_sumo.certainty.response.motion.actions import cases_of, pairs_of
from scex_sumo.certainty.response.motion.expected import Expected, expected_motion
from scex_sumo.certainty.response.people import people_of
from scex_sumo.scene import SeedScene

BOX_M: Final = 0.3
"""Error of lengths and widths."""
TURN_RAD: Final = float(np.deg2rad(2.0))
"""Error of headings, of both vehicles in opposite directions."""
MIN_SIZE_M: Final = 0.3


def varied(scene: SeedScene, pair: tuple[int, int], file: Path | None = None) -> Sequence[PairResponse]:
    """Return a pair with smaller and larger boxes, and with headings off either way, where P > 0."""
    expected, people = expected_motion(scene), people_of(file)
    index = np.flatnonzero(np.isin(expected.scene.track_ids, pair))
    responses: list[PairResponse] = []
    for size, turn in ((-BOX_M, 0.0), (BOX_M, 0.0), (0.0, TURN_RAD), (0.0, -TURN_RAD)):
        pairs = pairs_of(_changed(expected, index, size, turn), index)
        own = np.isin(pairs.initiator, index) & np.isin(pairs.responder, index)
        responses += pair_responses(decisive_rows(cases_of(pairs, own), people))
    return responses


def _changed(expected: Expected, index: np.ndarray, size: float, turn: float) -> Expected:
    scene, lines = expected.scene, expected.lines
    length, width, heading = scene.length.copy(), scene.width.copy(), lines.heading.copy()
    for values in (length, width):
        values[index] = np.maximum(values[index] + size, np.minimum(values[index], MIN_SIZE_M))
    heading[index] += turn * np.array([[1.0], [-1.0]])
    return replace(
        expected, scene=replace(scene, length=length, width=width), lines=replace(lines, heading=heading)
    )
