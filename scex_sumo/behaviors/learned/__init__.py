"""Learned drivers: inputs, networks, weights and behaviour models, without torch.

May import behaviors.driving, behaviors.scene_graph, behaviors.models and all below.
"""
