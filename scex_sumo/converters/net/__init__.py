"""SUMO nets: reader, lane table, drawing, and the registry of their writers."""
