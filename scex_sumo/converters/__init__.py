"""Converters from maps and recordings to roads, SUMO nets and seed scenes.

May import roads, geometry, scene and all below; not world, behaviors.
"""
