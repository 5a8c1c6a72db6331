"""Tracks from recorded samples: rows, boxes, recordings from a car."""
