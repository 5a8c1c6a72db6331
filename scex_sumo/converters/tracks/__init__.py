"""Track files in INTERACTION format, and tracks as arrays."""
