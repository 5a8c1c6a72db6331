"""Extra futures of a run: for exact probabilities, and for rare collisions."""
