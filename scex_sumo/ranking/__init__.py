"""Ranking of whole recordings: cut into seed scenes, run, and ordered by what is worth testing.

May import everything but commands.
"""
