"""Metrics of files: recordings, cases and result folders as blocks, and values as Arrow tables.

May import metrics, converters, results and all below; not behaviors, world.
"""
