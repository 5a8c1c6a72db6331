"""Geometry of the plane: polylines, rectangles, crossings, frames. Arrays in, arrays out.

May import arrays and scene's constants; knows no road.
"""
