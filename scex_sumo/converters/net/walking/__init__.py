"""Ways on foot of a SUMO net: crossings, walking areas and sidewalks.

May import roads, geometry, road, and the elements of the net.
"""
