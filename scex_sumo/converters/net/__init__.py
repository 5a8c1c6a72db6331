"""Writer of SUMO nets: a road as edges, connections, nodes, lights, and text.

May import roads, geometry, road; no SUMO.
"""
