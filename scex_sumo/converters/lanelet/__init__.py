"""Lanelet2 maps: read, repaired, turned into roads. No other package imports lanelet2.

May import roads, geometry, road.
"""
