"""Track files in INTERACTION format: found, read, checked.

May import converters.formats and files.
"""
