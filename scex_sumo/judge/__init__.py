"""Fidelity judge: how faithful a SUMO net is to its map; shares nothing with the writer.

May import geometry, roads and converters.lanelet; sumolib and libsumo for loading tests.
"""
