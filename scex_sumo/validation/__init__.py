"""Validation: seed scenes of recordings run with a mix of models and compared with what really happened.

May import ranking and everything below it; not commands.
"""
