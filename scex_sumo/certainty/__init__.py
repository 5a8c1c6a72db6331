"""Certainty: exact probabilities of events that are functions of the vehicles' models."""

from typing import Final

EXACT: Final = "exact.json"
"""Tables of exact probabilities in a result folder."""
