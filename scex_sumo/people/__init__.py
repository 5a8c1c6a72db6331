"""Behaviour models of pedestrians and cyclists: human-like ones, and those of the stress test."""
