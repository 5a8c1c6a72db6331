"""Plan of a SUMO net: shapes, right of way, lights and people."""
