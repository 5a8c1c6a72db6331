"""Geometry of polylines, crossings and rectangles in the plane.

May import scene and all below.
"""
