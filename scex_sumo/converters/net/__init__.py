"""Writer of SUMO nets: a road as edges, connections, nodes, lights, and text; no SUMO."""
