"""Pairs of a scene that metrics look at: by heading, on planned paths, at crossings.

May import geometry, scene and metrics.base.
"""
