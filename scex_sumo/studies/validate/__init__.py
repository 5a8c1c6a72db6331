"""Validation: a mix of models against what really happened in recordings."""
