"""Exporters: children and their road in the formats of other simulators.

May import results, views, behaviors, world, converters and all below; not extrapolation.
"""
