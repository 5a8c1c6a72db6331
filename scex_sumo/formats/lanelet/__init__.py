"""Repairs of Lanelet2 maps: broken elements, unknown subtypes, stops and lights that no lanelet names."""
