"""Lanelet2 maps: read, repaired, turned into roads. Only here: lanelet2.

May import roads, geometry, road.
"""
