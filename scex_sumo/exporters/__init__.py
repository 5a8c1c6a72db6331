"""Exporters: children of a run and their road in the formats of other simulators.

May import results, views, converters and all below; behaviour models and extrapolation are not known here.
"""
