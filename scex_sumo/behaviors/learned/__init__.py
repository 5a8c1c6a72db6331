"""Learned drivers: their inputs, networks, weights and behaviour models. Importing it loads no torch."""
