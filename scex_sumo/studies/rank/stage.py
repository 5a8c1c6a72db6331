"""Stage of an encounter: two vehicles zoomed, as recorded, and in the future that decides, for the page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from scex_sumo.base.arrays import BoolArray, FloatArray
from scex_sumo.decision.pairs import indices_of
from scex_sumo.page.html import Html, element
from scex_sumo.page.picture import lane_lines, outline_svg, road_svg, scene_svg
from scex_sumo.page.report.scene import Box
from scex_sumo.results.participants import everybody, with_everybody
from scex_sumo.results.parts import Part
from scex_sumo.scene import HISTORY_STEPS, STEP_S, SeedScene, States

_MARGIN_M = 10.0
_MIN_WIDTH_M = 45.0  # width of a picture
_ASPECT = 0.6  # height over width
_STEPS: Final = 30  # of a recording after the moment
_BEYOND: Final = 10  # steps that a future is shown after its conflict
_LAST: Final = 31  # steps up to the contact that a picture encloses; it begins when both are inside


@dataclass(frozen=True, kw_only=True, eq=False)
class Stage:
    """Picture of an encounter, with outlines that a script moves and the numbers of the last two.

    Outlines: x, y in m and turn in degrees by step, from the first one on in which both vehicles are in the
    picture, at most 1 s before the moment; None: not recorded. ``contact`` is a step.
    """

    picture: Html
    outlines: list[list[tuple[float, float, float] | None]]
    contact: int


def stage_of_future(scene: SeedScene, pair: Mapping[str, Any], human: Part) -> Stage:
    """Return the stage of a row of `scex_sumo.decision.pairs.PAIRS`, from human-like futures of its scene."""
    whole = everybody(scene)
    acting, other = indices_of(whole, (pair["other_id"], pair["track_id"])).tolist()
    index = int(np.searchsorted(human.futures, pair["future"]))
    driven = with_everybody(scene, human.states[index : index + 1])[0, HISTORY_STEPS:].swapaxes(0, 1)
    last = min(round(pair["conflict_s"] / STEP_S) + _BEYOND, driven.shape[1] - 1)
    return stage_of_motion(whole, (acting, other), driven[[acting, other], : last + 1])


def stage_of_motion(scene: SeedScene, pair: tuple[int, int], motion: States) -> Stage:
    """Return the stage of two of `everybody`, the first of which acts, with their motion (2, T) from now on.

    What was recorded is shown beside it, from 1 s before the moment on.
    """
    assert scene.road is not None
    acting, other = pair
    states, known = _recorded(scene)
    happens = States.concatenate([scene.history[[acting, other], :-1], motion], axis=1)
    box = _box(happens[:, -_LAST:])
    begins = int(np.argmax(_inside(happens, box).all(axis=0)))  # fast vehicles have to come near first
    happens, states, known = happens[:, begins:], states[:, begins:], known[:, begins:]
    tracks, shown = [], []
    for v in np.flatnonzero((_inside(states, box) & known).any(axis=1)).tolist():
        kind = "ghost" if v in (acting, other) else "vehicle"
        tracks.append(_outline(states[v], known[v]))
        shown.append(outline_svg(kind, scene.length[v], scene.width[v]))
    for index, v in enumerate((acting, other)):
        tracks.append(_outline(happens[index], np.ones(happens.shape[1], np.bool_)))
        shown.append(outline_svg(("acts", "responds")[index], scene.length[v], scene.width[v]))
    shown += [element("text.number", str(scene.track_ids[v])) for v in (acting, other)]
    road = road_svg(lane_lines(scene.road, box))
    picture = scene_svg("the two vehicles, from above", box, road, shown)
    return Stage(picture=picture, outlines=tracks, contact=happens.shape[1] - 1)


def _recorded(scene: SeedScene) -> tuple[States, BoolArray]:
    """Return the states (V, T) of a recording from 1 s before a moment to 3 s after it, and what is known."""
    known = np.arange(HISTORY_STEPS, -1, -1) <= scene.recorded_steps[:, None]
    if scene.future is None:
        return scene.history, known
    future, valid = scene.future[:, :_STEPS], scene.future_valid
    valid = np.ones(future.shape, np.bool_) if valid is None else valid[:, :_STEPS]
    return States.concatenate([scene.history, future], axis=1), np.concatenate([known, valid], axis=1)


def _box(happens: States) -> Box:
    """Return a box around the way of two vehicles up to their contact."""
    left, right = float(happens.x.min()) - _MARGIN_M, float(happens.x.max()) + _MARGIN_M
    low, high = float(happens.y.min()) - _MARGIN_M, float(happens.y.max()) + _MARGIN_M
    wide = max(right - left, (high - low) / _ASPECT, _MIN_WIDTH_M)
    x, y = (left + right) / 2, (low + high) / 2
    return x - wide / 2, x + wide / 2, y - _ASPECT * wide / 2, y + _ASPECT * wide / 2


def _inside(states: States, box: Box) -> BoolArray:
    left, right, low, high = box
    return (states.x > left) & (states.x < right) & (states.y > low) & (states.y < high)


def _outline(states: States, known: BoolArray) -> list[tuple[float, float, float] | None]:
    turn: FloatArray = np.degrees(np.unwrap(states.heading))
    poses = zip(states.x.round(2).tolist(), states.y.round(2).tolist(), turn.round(1).tolist(), strict=True)
    return [pose if there else None for pose, there in zip(poses, known.tolist(), strict=True)]
