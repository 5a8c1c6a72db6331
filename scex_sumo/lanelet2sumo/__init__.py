"""Writer of SUMO nets: a road as edges, connections, nodes, lights, and text; and the judge of such nets."""
