"""Inspection of a recording before a run."""
