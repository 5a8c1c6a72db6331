"""Fidelity judge: how faithful a SUMO net is to its map."""
