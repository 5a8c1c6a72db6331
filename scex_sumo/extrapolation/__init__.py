"""Extrapolation of a seed scene to future scenarios, in closed loop, over worker processes."""
