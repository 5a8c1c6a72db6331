"""Explanation of a run: which vehicle's model makes it critical, and its page."""
