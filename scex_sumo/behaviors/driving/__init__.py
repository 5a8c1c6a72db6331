"""Driving along a path: paths of a seed scene, motion, leaders."""
