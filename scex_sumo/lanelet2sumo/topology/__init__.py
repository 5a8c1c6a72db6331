"""Topology of a SUMO net: rows of lanes, cut into edges and junctions."""
