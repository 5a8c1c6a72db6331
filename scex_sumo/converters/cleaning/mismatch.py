"""Mismatch of tracks and map: a wrong origin, or a map of another site."""

from __future__ import annotations

import numpy as np

from scex_sumo.converters.tracks.evidence import Evidence, on_lanes
from scex_sumo.road import Road

FITTING_SHARE = 0.8  # with this much of the driving on lanes after a shift, the map is the right one
MIN_GAIN = 0.05  # of the driving that a shift must bring onto lanes before the origin is doubted
MIN_SHIFT_M = 2.0  # of an origin in doubt
EARTH_M = 111_320.0  # per degree of latitude


def explain_mismatch(samples: Evidence, road: Road) -> str:
    """Explain why tracks do not lie on a map's lanes: a phrase with the remedy.

    If one shift puts all tracks onto lanes, the origin is wrong; else the map is of another site.
    """
    wrong = f"the map's origin is not the recording's (used: {road.origin[0]:g},{road.origin[1]:g})"
    remedy = "give --origin LAT,LON"
    if road.net is not None:  # its coordinates are fixed
        wrong, remedy = "the map's coordinates are not the recording's", "give the map of these tracks"
    from scex_sumo.converters.cleaning.shift import find_shift

    shift = find_shift(samples, road)
    if shift is None:
        return f"{wrong}, or the map is another site's; {remedy}"
    dx, dy, share = shift
    if share >= FITTING_SHARE:
        moved = f"moved by {dx:+.0f} m, {dy:+.0f} m, {share:.0%} of its driving is on lanes"
        return f"{wrong}: {moved}; {remedy}"
    return "no other origin puts them on lanes, so the tracks belong to another map; give that map"


def doubt_place(samples: Evidence, road: Road) -> str | None:
    """Return a warning if tracks lie beside the lanes and a shift of over 2 m puts more onto lanes."""
    share = on_lanes(samples, road)
    if share > 1.0 - MIN_GAIN:
        return None
    from scex_sumo.converters.cleaning.shift import find_shift

    shift = find_shift(samples, road)
    if shift is None or shift[2] - share < MIN_GAIN or np.hypot(*shift[:2]) <= MIN_SHIFT_M:
        return None
    (dx, dy, after), (lat, lon) = shift, road.origin
    place = lat + dy / EARTH_M, lon + dx / EARTH_M / np.cos(np.deg2rad(lat))
    near = f"; one near {place[0]:.5f},{place[1]:.5f} fits better" if (lat, lon) != (0.0, 0.0) else ""
    return (
        f"warning: only {share:.0%} of where the vehicles drive is on lanes; moved by {dx:+.0f} m, "
        f"{dy:+.0f} m it is {after:.0%}: check the map's origin ({lat:.5f},{lon:.5f}){near}"
    )
