"""Metrics of recordings, files of cases and result folders, as Arrow tables.

May import metrics, converters, results and all below; not behaviors, world.
"""
