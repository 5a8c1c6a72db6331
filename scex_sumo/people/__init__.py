"""Behaviour models of pedestrians and cyclists."""
