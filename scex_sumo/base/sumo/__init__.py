"""SUMO as installed: its programs and files, its car-following models."""
