"""Inputs of the learned drivers: paths, room beside them, top-down image."""
