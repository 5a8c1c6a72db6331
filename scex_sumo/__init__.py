"""Hundreds of futures of one moment of traffic, and how critical it can become."""

__version__ = "0.1.0"
