"""Geometry of the plane: polylines, rectangles, crossings.

May import arrays and scene; knows no road.
"""
