"""Semantic scene graph: vehicles as nodes, edges where the lanes relate two of them."""
