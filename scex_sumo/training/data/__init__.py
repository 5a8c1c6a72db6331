"""Samples for training: scene graphs, targets, copies, and the cache that keeps them.

May import behaviors, converters and all below.
"""
