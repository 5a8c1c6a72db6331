"""Driving along a path: paths of a seed scene, motion, leaders, perception.

May import roads, geometry, scene; no other room of behaviors.
"""
