"""Moments of a recording as seed scenes: which there are, sampled, written.

May import converters.tracks, converters.cleaning, scene.
"""
