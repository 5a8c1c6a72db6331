"""Mirror image of roads and scenes: traffic on the left is traffic on the right, seen in a mirror.

Drivers, SUMO's world and the writer of nets know traffic on the right alone; the image has y and headings
negated, exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.owned import owner_cache
from scex_sumo.road import Lane, Road
from scex_sumo.road_rules import Rules
from scex_sumo.scene import SceneHistory, SeedScene, States

S = TypeVar("S", bound=States)


def mirrored_states(states: S) -> S:
    """Return the image of states, or of a plan."""
    return replace(states, y=-states.y, heading=-states.heading)


def mirrored_line(line: FloatArray) -> FloatArray:
    """Return the image (P, 2) of a line."""
    return line * (1.0, -1.0)


def mirrored_lane(lane: Lane) -> Lane:
    """Return the image of a lane: its left side is on the right."""
    return replace(
        lane,
        centreline=mirrored_line(lane.centreline),
        left_bound=mirrored_line(lane.right_bound),
        right_bound=mirrored_line(lane.left_bound),
        left=lane.right,
        right=lane.left,
        adjacent_left=lane.adjacent_right,
        adjacent_right=lane.adjacent_left,
    )


@owner_cache
def mirrored_road(road: Road) -> Road:
    """Return the image of a road, with the same ids; its ``net`` is not mirrored."""
    place = road.georeference
    return replace(
        road,
        lanes={i: mirrored_lane(lane) for i, lane in road.lanes.items()},
        regulations=tuple(
            replace(rule, stop_lines=tuple(map(mirrored_line, rule.stop_lines))) for rule in road.regulations
        ),
        markings=tuple(replace(mark, points=mirrored_line(mark.points)) for mark in road.markings),
        areas=tuple(replace(area, outline=mirrored_line(area.outline)) for area in road.areas),
        georeference=None if place is None else replace(place, north_m=-place.north_m),
        left_hand=not road.left_hand,
    )


@owner_cache
def mirrored_scene(scene: SeedScene) -> SeedScene:
    """Return the image of a scene and of its road."""
    others = scene.obstacles
    return replace(
        scene,
        history=mirrored_states(scene.history),
        future=None if scene.future is None else mirrored_states(scene.future),
        obstacles=None if others is None else replace(others, states=mirrored_states(others.states)),
        road=None if scene.road is None else mirrored_road(scene.road),
        rules=None if scene.rules is None else _mirrored_rules(scene.rules),
    )


def drawn_on(road: Road, draw: Callable[[Road], SeedScene]) -> SeedScene:
    """Return the scene that a function draws on a road, or on its image where traffic drives on the left."""
    if not road.left_hand:
        return draw(road)
    return replace(mirrored_scene(draw(mirrored_road(road))), road=road)


def _mirrored_rules(rules: Rules) -> Rules:
    return replace(
        rules,
        passages=tuple(replace(passage, line=mirrored_line(passage.line)) for passage in rules.passages),
        stop_lines=tuple(map(mirrored_line, rules.stop_lines)),
        crosswalks=tuple(map(mirrored_line, rules.crosswalks)),
    )


@owner_cache
def mirrored_history(history: SceneHistory) -> SceneHistory:
    """Return the image of what drivers see."""
    scene, states = mirrored_scene(history.scene), mirrored_states(history.states)
    return replace(history, scene=scene, states=states)
