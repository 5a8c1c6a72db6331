"""Comparison of runs: distances between densities, groups of runs, and its page."""
