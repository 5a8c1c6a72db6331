"""Plug-ins: models of the user's own by import path, function or file, and who stands in when they fail.

May import behaviors.models, behaviors.scene_graph and all below.
"""
