"""Vehicles off the lanes: why, and what to do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.base.errors import TrackError, listed
from scex_sumo.converters.cleaning.mismatch import doubt_place, explain_mismatch
from scex_sumo.converters.tracks.evidence import Evidence, on_lanes, thinned
from scex_sumo.road import Road
from scex_sumo.roads.matching import match
from scex_sumo.scene import SeedScene

MIN_SHARE_ON_LANES = 0.1  # a recording with less of its driving on lanes does not belong to its map


def explain_off_lanes(
    scene: SeedScene, off: list[int], samples: Evidence, road: Road, *, simulated: bool
) -> TrackError:
    """Error about the vehicles of a seed scene that are ``off`` the lanes."""
    now = scene.now
    here = Evidence(x=now.x[off], y=now.y[off], heading=now.heading[off], track=np.arange(len(off)))
    share, doubt = on_lanes(samples, road), None if simulated else doubt_place(samples, road)
    if closed := on_closed_lanes(here, road):
        why = f"{closed}, or choose another moment with --time S"
    elif simulated:
        why = "the simulation has them beside the lanes for cars; choose another moment with --time S"
    elif doubt is None and len(samples.x) and share >= MIN_SHARE_ON_LANES:
        why = f"though {share:.0%} of the recording's driving is; choose another moment with --time S"
    else:
        why = doubt.removeprefix("warning: ") if doubt else explain_mismatch(samples, road)
    forced = "; read_seed(..., force=True) runs it all the same" if len(off) < scene.vehicles else ""
    beside = f"{len(off)} of {scene.vehicles} vehicles are on no mapped lane of their direction"
    return TrackError(f"{scene.name}: {beside}; {why}{forced}")


def on_closed_lanes(samples: Evidence, road: Road) -> str | None:
    """Return a phrase with the remedy if most samples lie on lanes that the map closes to cars."""
    lanes = {i: replace(lane, kind="vehicle") for i, lane in road.lanes.items() if lane.kind != "vehicle"}
    few = thinned(samples, most=400)
    matches = match(replace(road, lanes=lanes), few.x, few.y, few.heading)
    if 2 * len(np.unique(matches.vehicle)) <= len(few.x):
        return None
    names = sorted({lanes[int(i)].subtype or str(i) for i in matches.lane_id})
    return f"they are on lanes that the map closes to cars: {listed(names)}; allow cars there"
