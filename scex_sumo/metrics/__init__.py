"""Criticality metrics: nanoscopic values per pair, microscopic values per child. Arrays in, arrays out.

May import geometry, scene and all below; knows neither files nor SUMO.
"""
