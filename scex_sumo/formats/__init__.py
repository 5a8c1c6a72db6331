"""Formats wing: readers of maps and recordings beyond Lanelet2 and INTERACTION."""
