"""Tables and sentences for the terminal.

May import studies, results and all below; no matplotlib.
"""
