"""Extrapolation of a seed scene to child scenarios, in closed loop, over worker processes."""
