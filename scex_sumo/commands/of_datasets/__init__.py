"""Commands that take whole datasets: rank their moments, validate on them, train on them.

May import everything but the other commands; shared are console and options.
"""
