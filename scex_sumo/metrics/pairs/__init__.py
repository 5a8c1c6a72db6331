"""Pairs of vehicles: all, followers and leaders, on crossing paths."""
