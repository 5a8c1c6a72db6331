"""Validation: seed scenes of recordings run with a mix of models and compared with what really happened."""
