"""Driving functions under test: the same futures with and without them."""
