"""Moments of recordings: cut, run, kept and shared out to workers, for ranking and validation alike."""
