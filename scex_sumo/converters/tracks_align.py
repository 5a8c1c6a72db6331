"""Residual offset between recorded tracks and their map."""

from __future__ import annotations

from scex_sumo.converters.tracks_rows import TrackTable
from scex_sumo.road import Road


def align_tracks(table: TrackTable, road: Road) -> tuple[TrackTable, str | None]:
    """Move and turn a recording onto the lanes of its map, where the data say that it is off."""
    return table, None
