"""Formulas of the metrics.

May import metrics.base, pairs, geometry and all below; no registry, no aggregation.
"""
