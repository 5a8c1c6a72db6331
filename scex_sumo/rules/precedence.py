"""Precedence of the vehicles of a seed scene: who must yield to whom, and who has red."""

from __future__ import annotations

from scex_sumo.behaviors.driving.paths import seed_paths
from scex_sumo.road import Road
from scex_sumo.rules.holds import lights
from scex_sumo.rules.passages import ruled_ways
from scex_sumo.rules.states import straight_traffic
from scex_sumo.scene import SceneHistory, SeedScene

MUST_YIELD, HAS_RED = "must yield", "has red"


def precedence(scene: SeedScene, road: Road) -> list[tuple[int, int, str]]:
    """Return (track, other track, what rules say of the first) where straightest paths conflict."""
    rules = scene.rules
    if rules is None:
        return []
    paths, history = seed_paths(scene, road), SceneHistory.of_scene(scene)
    ways, traffic, lit = ruled_ways(paths, rules), straight_traffic(history, paths), lights(history, paths)
    straight, tracks, rules_of = paths.first + paths.straight, scene.track_ids.tolist(), {}
    for k, (own, other) in enumerate(zip(ways.own.tolist(), ways.other.tolist(), strict=True)):
        one, two = (int(ways.vehicle[ways.row[entry]]) for entry in (own, other))
        ahead = all(
            straight[v] == ways.row[entry] and traffic.rear[0, v] < span[k, 1]
            for v, entry, span in ((one, own, ways.own_span), (two, other, ways.other_span))
        )
        red = [
            lit.red[0, ways.signal[entry]] and traffic.front[0, v] < ways.stop[entry]
            for v, entry in ((one, own), (two, other))
        ]
        if not ahead or one == two or all(red):
            continue
        if red[1]:
            rules_of[two, one] = HAS_RED
        elif red[0] or not (ways.mutual[k] or lit.free[0, ways.signal[own]]):
            rules_of[one, two] = HAS_RED if red[0] else MUST_YIELD
    return [(tracks[one], tracks[two], what) for (one, two), what in rules_of.items()]
