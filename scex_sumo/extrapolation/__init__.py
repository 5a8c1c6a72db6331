"""Extrapolation of a seed scene to child scenarios, in closed loop, over worker processes.

May import behaviors, world, metrics, scenarios, results and evaluation, and all below; not studies, reports.
"""
