"""Plug-ins: users' models by import path, function or file, and the fallback planner.

May import behaviors.models, behaviors.scene_graph and all below.
"""
