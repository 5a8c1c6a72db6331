"""Results cached in memory: made once for an owner, and freed with it."""

from __future__ import annotations

import gc
import weakref

from scex_sumo.base import owned as module
from scex_sumo.behaviors.driving.motion import curve_speeds
from scex_sumo.behaviors.driving.paths import chosen_paths
from scex_sumo.behaviors.models.idm import desired_speeds
from scex_sumo.graphs.graph import scene_graph
from scex_sumo.humans.guard.corridors import expected
from scex_sumo.learned.inputs.surface import path_room, raster_of
from scex_sumo.plug_in.inputs import lane_pieces
from tests.behaviors import roads


def test_all_that_is_derived_from_a_road_a_scene_and_a_history_goes_with_them() -> None:
    road, scene = roads.fork(), roads.scene_of((20.0, 0.0, 0.0, 10.0))
    history = roads.present(scene)
    paths, _ = chosen_paths(history, road, roads.every(history), "straight")
    desired_speeds(paths, 0.0, 1.0), curve_speeds(paths, 1.0, 1.0), path_room(paths, road)
    scene_graph(history, road), scene_graph(scene, road), expected(history, road)
    raster_of(road), lane_pieces(road, 10, 2.0)
    watched = [weakref.ref(owner) for owner in (road, scene, history, paths)]
    assert {type(owner()) for owner in watched} <= set(module._by_owner)
    del road, scene, history, paths
    gc.collect()
    assert [owner() for owner in watched] == [None] * 4
