"""Criticality metrics: nanoscopic values per pair, microscopic values per child.

May import geometry, scene and all below; knows neither files nor SUMO.
"""
