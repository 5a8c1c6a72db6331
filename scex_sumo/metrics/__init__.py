"""Criticality metrics: nanoscopic values per pair, microscopic values per future."""
