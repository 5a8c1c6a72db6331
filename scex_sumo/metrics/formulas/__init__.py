"""Formulas of the metrics between vehicles that follow each other or whose paths cross, one module each.

May import the tracks of `base`, pairs, geometry and all below; no registry, no aggregation.
"""
