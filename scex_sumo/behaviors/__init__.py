"""Behaviour models: who drives how.

May import roads, geometry, scene and all below; not world, results or metrics.
"""
