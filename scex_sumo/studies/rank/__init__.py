"""Ranking of a dataset's moments by how critical they can become, and its page."""
