"""Cleaning of recorded tracks: copies, headings, jitter, offsets to the map."""
