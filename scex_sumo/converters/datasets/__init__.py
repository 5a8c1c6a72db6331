"""Datasets: recordings found in folders, read, cleaned, reported on."""
