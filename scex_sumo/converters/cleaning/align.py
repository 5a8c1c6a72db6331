"""Alignment of tracks to their map.

Tracks and map are surveyed independently and often differ by half a metre and a degree.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from scex_sumo.converters.tracks.evidence import Evidence, evidence, thinned
from scex_sumo.converters.tracks.rows import TrackTable
from scex_sumo.road import Road

OWN_TRACKS, ENOUGH_TRACKS = 100, 200  # with fewer own tracks, other recordings of the site are read
MIN_SAMPLES, MIN_TRACKS = 500, 20  # with fewer nothing is done


def align_tracks(
    table: TrackTable, road: Road, *, siblings: Iterable[tuple[str, Evidence]] = ()
) -> tuple[TrackTable, tuple[str, ...]]:
    """Move a recording onto the lanes of its map if its vehicles drive beside them.

    Shift and rotation are the least-squares fit of moving vehicles' centres to the centrelines. A track
    counts by the root of its samples. A common habit of driving left or right of the middle is kept.

    Args:
        siblings: name and evidence of other recordings of the site; read only if the own evidence is thin.

    Returns:
        The table, and a phrase about the shift; none if the evidence is too thin or the tracks are right.
    """
    parts = [(table.path.name, evidence(table.vehicles))]
    if parts[0][1].tracks < OWN_TRACKS:
        for sibling in siblings:
            if sum(part.tracks for _, part in parts) >= ENOUGH_TRACKS:
                break
            parts.append(sibling)
    pooled = thinned(_pooled([part for _, part in sorted(parts, key=lambda named: named[0])]))
    if len(pooled.x) < MIN_SAMPLES or pooled.tracks < MIN_TRACKS:
        return table, ()
    from scex_sumo.converters.cleaning.fit import find_alignment

    estimate = find_alignment(pooled, road)
    if estimate is None:
        return table, ()
    alignment, before, after = estimate
    others = f", estimated from {len(parts)} recordings of the site" if len(parts) > 1 else ""
    finding = (
        f"tracks aligned to the map: dx {alignment.dx:+.2f} m, dy {alignment.dy:+.2f} m, rotation "
        f"{math.degrees(alignment.turn):+.2f} degrees (median distance to lane centre {before:.2f} -> "
        f"{after:.2f} m{others})"
    )
    vehicles, rest = alignment.moved(table.vehicles), alignment.moved(table.others)
    return replace(table, vehicles=vehicles, others=rest), (finding,)


def _pooled(parts: Sequence[Evidence]) -> Evidence:
    begins = np.cumsum([0, *(part.tracks for part in parts)])
    return Evidence(
        x=np.concatenate([part.x for part in parts]),
        y=np.concatenate([part.y for part in parts]),
        heading=np.concatenate([part.heading for part in parts]),
        track=np.concatenate([part.track + n for part, n in zip(parts, begins[:-1], strict=True)]),
    )
