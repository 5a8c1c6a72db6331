"""Pieces of a SUMO net: rows of lanes cut at forks and conflicts, and the rules between them.

May import roads, geometry, road.
"""
