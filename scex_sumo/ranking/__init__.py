"""Whole recordings cut into seed scenes, run, and ranked: which moments are worth testing."""
