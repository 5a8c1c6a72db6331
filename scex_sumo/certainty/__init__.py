"""Exact probabilities of events that are functions of the vehicles' models: trees, tables, cut sets, weights.

May import statistics and base only; knows nothing of vehicles but their numbers.
"""
