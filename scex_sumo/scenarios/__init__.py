"""Example seeds of our own making, and synthetic seeds populated by SUMO."""
