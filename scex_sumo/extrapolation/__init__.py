"""Extrapolation of a seed scene to futures, in closed loop, over worker processes."""
