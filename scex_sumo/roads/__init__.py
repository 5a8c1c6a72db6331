"""Questions to a road: matching, routes, conflicts, relations of lanes.

May import geometry, road and all below; knows no files.
"""
