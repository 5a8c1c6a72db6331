"""Outcomes and metrics between the vehicles' outlines: collisions, body gap, worst time, preset ``path``.

May import what metrics may import.
"""
