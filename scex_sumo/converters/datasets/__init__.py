"""Datasets: recordings found in folders, read in every format, reported on.

May import the other rooms of converters.
"""
