"""Alignment of tracks to their map, by the poses of moving vehicles.

Tracks and map are surveyed independently and often differ by half a metre and a degree. Larger offsets are
a wrong origin, a map of another site, or lanes that are closed to cars: see `place`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from scex_sumo.converters.tracks.rows import TrackRows, TrackTable, joined_rows
from scex_sumo.geometry.polylines import wrap
from scex_sumo.road import Road
from scex_sumo.roads.matching import match

MOVING_MPS = 2.0  # slower samples tell nothing about lanes
SAMPLE_M = 1.0
MAX_SAMPLES = 2000  # more are thinned out evenly
OWN_TRACKS, ENOUGH_TRACKS = 100, 200  # with fewer own tracks, other recordings of the site are read
MIN_SAMPLES, MIN_TRACKS = 500, 20  # with fewer nothing is done
MIN_OTHER_DIRECTIONS = 0.1


def evidence(rows: TrackRows) -> TrackRows:
    """Return one sample for every metre that vehicles drive, without tracks that do not move."""
    joined = np.diff(rows.segment) == 0
    step = np.where(joined, np.hypot(np.diff(rows.x), np.diff(rows.y)), 0.0)
    mark = np.floor(np.append(0.0, np.cumsum(step)) / SAMPLE_M)
    keep = np.append(True, ~joined | (np.diff(mark) > 0.0))[: len(rows)] & (rows.speed > MOVING_MPS)
    return rows.take(keep)


def thinned(samples: TrackRows, most: int = MAX_SAMPLES) -> TrackRows:
    """Return at most so many samples, evenly taken."""
    if len(samples) <= most:
        return samples
    return samples.take(np.linspace(0, len(samples) - 1, most).astype(np.int64))


def on_lanes(samples: TrackRows, road: Road) -> float:
    """Return the share of samples that match a lane; 1 without samples."""
    few = thinned(samples, most=400)
    return len(match(road, few.x, few.y, few.psi_rad).best) / len(few) if len(few) else 1.0


def align_tracks(
    table: TrackTable, road: Road, *, siblings: Iterable[tuple[str, TrackRows]] = ()
) -> tuple[TrackTable, tuple[str, ...]]:
    """Move a recording onto the lanes of its map if its vehicles drive beside them.

    Shift and rotation are the least-squares fit of moving vehicles' centres to the centrelines. A track
    counts by the root of its samples. A common habit of driving left or right of the middle is kept.

    ``siblings``, name and `evidence` of other recordings of the site, are read if the own evidence is thin.
    The phrase is about the shift; none if the evidence is too thin or the tracks are right.
    """
    recordings = [(table.path.name, evidence(table.vehicles))]
    if recordings[0][1].tracks < OWN_TRACKS:
        for sibling in siblings:
            if sum(samples.tracks for _, samples in recordings) >= ENOUGH_TRACKS:
                break
            recordings.append(sibling)
    pooled = thinned(joined_rows(*(samples for _, samples in sorted(recordings, key=lambda named: named[0]))))
    if len(pooled) < MIN_SAMPLES or pooled.tracks < MIN_TRACKS:
        return table, ()
    bins = np.bincount(np.floor(pooled.psi_rad / (np.pi / 8.0)).astype(np.int64) % 16, minlength=16)
    main = (np.argmax(bins) + 0.5) * np.pi / 8.0
    if (np.abs(wrap(pooled.psi_rad - main)) > np.pi / 4.0).mean() < MIN_OTHER_DIRECTIONS:
        return table, ()
    from scex_sumo.converters.cleaning.fit import Alignment, fit_to_lanes, is_certain, matched

    fit = fit_to_lanes(pooled, road)
    before, after = (matched(pooled, road, fitted)[-1] for fitted in (Alignment(centre=fit.centre), fit))
    if not is_certain(fit, pooled, road, before):
        return table, ()
    basis = f", estimated from {len(recordings)} recordings of the site" if len(recordings) > 1 else ""
    finding = (
        f"tracks aligned to the map: dx {fit.dx:+.2f} m, dy {fit.dy:+.2f} m, rotation "
        f"{math.degrees(fit.turn):+.2f} degrees (median distance to lane centre "
        f"{np.median(np.abs(before)):.2f} -> {np.median(np.abs(after)):.2f} m{basis})"
    )
    vehicles, others = fit.moved(table.vehicles), fit.moved(table.others)
    return replace(table, vehicles=vehicles, others=others), (finding,)
