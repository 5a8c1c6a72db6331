"""Semantic scene graph: vehicles as nodes, edges where the lanes relate two of them.

May import roads, geometry, scene, behaviors.driving.
"""
