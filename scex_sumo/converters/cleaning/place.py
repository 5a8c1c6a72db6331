"""Place of a map: why vehicles are off its lanes, and by which shift they would be on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scex_sumo.base.arrays import FloatArray
from scex_sumo.base.errors import TrackError, listed
from scex_sumo.converters.cleaning.align import on_lanes, thinned
from scex_sumo.converters.cleaning.fit import fit_to_lanes
from scex_sumo.converters.tracks.rows import TrackRows
from scex_sumo.geometry.polylines import along, arc_lengths, wrap
from scex_sumo.road import Road
from scex_sumo.roads.matching import match
from scex_sumo.scene import SeedScene

MIN_SHARE_ON_LANES = 0.1  # a recording with less of its driving on lanes does not belong to its map
FITTING_SHARE = 0.8  # with this much of the driving on lanes after a shift, the map is the right one
DOUBT_GAIN = 0.05  # of the driving that a shift must bring onto lanes before the origin is doubted
MIN_SHIFT_M = 2.0  # of an origin in doubt
EARTH_M = 111_320.0  # per degree of latitude
SHIFT_TRACKS, SHIFT_COURSES = 3, 3  # with fewer any map fits
CELL_M, COURSES, MAX_CELLS = 4.0, 8, 1500


def explain_off_lanes(
    scene: SeedScene, off: list[int], samples: TrackRows, road: Road, *, simulated: bool
) -> TrackError:
    """Error about the vehicles of a seed scene that are ``off`` the lanes."""
    now = scene.now
    share, doubt = on_lanes(samples, road), None if simulated else doubt_place(samples, road)
    if closed := on_closed_lanes(now.x[off], now.y[off], now.heading[off], road):
        reason = f"{closed}, or choose another moment with --time S"
    elif simulated:
        reason = "the simulation has them beside the lanes for cars; choose another moment with --time S"
    elif doubt is None and len(samples) and share >= MIN_SHARE_ON_LANES:
        reason = f"though {share:.0%} of the recording's driving is; choose another moment with --time S"
    else:
        reason = doubt.removeprefix("warning: ") if doubt else explain_mismatch(samples, road)
    forced = "; read_seed(..., force=True) runs it all the same" if len(off) < scene.vehicles else ""
    beside = f"{len(off)} of {scene.vehicles} vehicles are on no mapped lane of their direction"
    return TrackError(f"{scene.name}: {beside}; {reason}{forced}")


def on_closed_lanes(x: FloatArray, y: FloatArray, heading: FloatArray, road: Road) -> str | None:
    """Return a phrase with the remedy if most poses (n,), m and rad, lie on lanes closed to cars."""
    lanes = {i: replace(lane, kind="vehicle") for i, lane in road.lanes.items() if lane.kind != "vehicle"}
    matches = match(replace(road, lanes=lanes), x, y, heading)
    if 2 * len(np.unique(matches.vehicle)) <= len(x):
        return None
    names = sorted({lanes[int(i)].subtype or str(i) for i in matches.lane_id})
    return f"they are on lanes that the map closes to cars: {listed(names)}; allow cars there"


def explain_mismatch(samples: TrackRows, road: Road) -> str:
    """Explain why tracks do not lie on a map's lanes: a phrase with the remedy.

    If one shift puts all tracks onto lanes, the origin is wrong; else the map is of another site.
    """
    wrong = f"the map's origin is not the recording's (used: {road.origin[0]:g},{road.origin[1]:g})"
    remedy = "give --origin LAT,LON"
    if road.net is not None:  # its coordinates are fixed
        wrong, remedy = "the map's coordinates are not the recording's", "give the map of these tracks"
    shift = _find_shift(samples, road)
    if shift is None:
        return f"{wrong}, or the map is another site's; {remedy}"
    dx, dy, share = shift
    if share >= FITTING_SHARE:
        moved = f"moved by {dx:+.0f} m, {dy:+.0f} m, {share:.0%} of its driving is on lanes"
        return f"{wrong}: {moved}; {remedy}"
    return "no other origin puts them on lanes, so the tracks belong to another map; give that map"


def doubt_place(samples: TrackRows, road: Road) -> str | None:
    """Return a warning if tracks lie beside the lanes and a shift of over 2 m puts more onto lanes."""
    share, shift = on_lanes(samples, road), _find_shift(samples, road)
    if shift is None or shift[2] - share < DOUBT_GAIN or np.hypot(*shift[:2]) <= MIN_SHIFT_M:
        return None
    (dx, dy, after), (lat, lon) = shift, road.origin
    place = lat + dy / EARTH_M, lon + dx / EARTH_M / np.cos(np.deg2rad(lat))
    near = f"; one near {place[0]:.5f},{place[1]:.5f} fits better" if (lat, lon) != (0.0, 0.0) else ""
    return (
        f"warning: only {share:.0%} of where the vehicles drive is on lanes; moved by {dx:+.0f} m, "
        f"{dy:+.0f} m it is {after:.0%}: check the map's origin ({lat:.5f},{lon:.5f}){near}"
    )


def _find_shift(samples: TrackRows, road: Road) -> tuple[float, float, float] | None:
    """Return the shift dx, dy, m, that puts most samples onto lanes, and their share on lanes then.

    None with too few tracks or directions, which fit any map.
    """
    if samples.tracks < SHIFT_TRACKS or len(np.unique(_course(samples.psi_rad))) < SHIFT_COURSES:
        return None
    shift = _best_shift(samples, road)
    if shift is None:
        return None
    moved = thinned(samples.with_columns(x=samples.x + shift[0], y=samples.y + shift[1]))
    fit = fit_to_lanes(moved, road)
    return shift[0] + fit.dx, shift[1] + fit.dy, on_lanes(fit.moved(moved), road)


def _course(heading: FloatArray) -> FloatArray:
    return np.asarray(np.rint(wrap(heading) / (2.0 * np.pi / COURSES)) % COURSES)


def _best_shift(samples: TrackRows, road: Road) -> tuple[float, float] | None:
    from scipy.signal import fftconvolve

    lanes = []
    for line in (lane.centreline for lane in road.vehicle_lanes.values() if len(lane.centreline) > 1):
        arc = arc_lengths(line)
        s = np.arange(0.0, arc[-1], CELL_M / 2.0)
        segment = np.clip(np.searchsorted(arc, s, side="right") - 1, 0, len(line) - 2)
        heading = np.arctan2(*np.diff(line, axis=0)[segment].T[::-1])
        lanes.append(np.column_stack((along(line, s), heading)))
    if not lanes:
        return None
    lane_points = np.concatenate(lanes)
    poses = np.stack((samples.x, samples.y, samples.psi_rad), axis=1)
    low = [points[:, :2].min(axis=0) for points in (lane_points, poses)]
    size = [np.ptp(points[:, :2], axis=0) // CELL_M + 1 for points in (lane_points, poses)]
    if max(float(s.max()) for s in size) > MAX_CELLS:
        return None
    shape = [tuple(int(n) for n in s) for s in size]
    total = np.zeros([a + b - 1 for a, b in zip(*shape, strict=True)])
    for course in range(COURSES):
        lane_cells, sample_cells = (
            _cells(points[_course(points[:, 2]) == course], begin, cells)
            for points, begin, cells in zip((lane_points, poses), low, shape, strict=True)
        )
        if sample_cells.any():
            total += fftconvolve(np.minimum(lane_cells, 1.0), sample_cells[::-1, ::-1])
    offset = np.array(np.unravel_index(int(np.argmax(total)), total.shape)) - (np.array(shape[1]) - 1)
    dx, dy = low[0] - low[1] + CELL_M * offset
    return float(dx), float(dy)


def _cells(points: FloatArray, begin: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    counts = np.zeros(shape)
    np.add.at(counts, tuple(((points[:, :2] - begin) // CELL_M).astype(np.int64).T), 1.0)
    return counts
