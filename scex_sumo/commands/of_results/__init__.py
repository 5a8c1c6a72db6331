"""Commands that read a finished result folder: what it says, shows and hands to other tools.

May import everything but the other commands; shared are console, options and metrics.
"""
