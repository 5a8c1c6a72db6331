"""Lanelet2 maps as roads. No other package imports lanelet2."""
