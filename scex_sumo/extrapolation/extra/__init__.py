"""Extra futures of a run for exact probabilities."""
