"""Exporters: children of a run and their road in the formats of other simulators.

May import results, views, pictures, behaviors, world, converters and all below; not extrapolation.
"""
