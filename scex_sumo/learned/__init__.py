"""Learned drivers: inputs, networks, weights and behaviour models, without torch."""
