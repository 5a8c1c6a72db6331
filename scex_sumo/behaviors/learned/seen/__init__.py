"""Inputs of the learned drivers besides the scene graph: path ahead, road surface, road picture.

May import behaviors.driving, behaviors.scene_graph and all below; no torch.
"""
