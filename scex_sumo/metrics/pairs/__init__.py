"""Pairs of vehicles that metrics evaluate: all, followers and leaders, on crossing paths.

May import geometry, scene and metrics.base.
"""
