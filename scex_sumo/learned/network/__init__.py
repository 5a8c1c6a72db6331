"""Networks of the learned drivers in NumPy, their architecture and weights."""
