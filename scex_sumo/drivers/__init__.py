"""Drivers: which behaviour models there are, by name, and how one is made and wrapped."""
