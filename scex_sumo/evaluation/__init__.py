"""Metrics of recordings, files of cases and result folders, as Arrow tables."""
