"""Certainty: exact probabilities of events that are functions of the vehicles' models."""

from typing import Final

EXACT: Final = "exact.json"
"""Tables of exact probabilities in a result folder."""

FITTED: Final = "fitted_weights.json"
"""Weights of the models that were fitted to the recording, in a result folder."""
