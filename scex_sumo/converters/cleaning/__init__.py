"""Cleaning of recorded tracks: copies, headings, jitter, offsets to the map.

May import geometry, roads, converters.tracks.rows.
"""
