"""OpenDRIVE: a road as reference lines, lanes with widths, links and junctions.

May import the road, roads and geometry; nothing of runs or children.
"""
