"""Certainty: exact probabilities of events that are functions of the vehicles' models."""
