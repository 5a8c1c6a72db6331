"""Learned drivers: their inputs, networks, weights and behaviour models. Importing it loads no torch.

May import behaviors.driving, behaviors.scene_graph, behaviors.models and all below.
"""
