"""Queries of a road: map matching, routes, conflicts and relations of lanes.

May import geometry, road and all below; knows no files.
"""
