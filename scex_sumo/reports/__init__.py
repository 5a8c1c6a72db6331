"""Reports: figures and terminal tables; the only package with matplotlib.

May import extrapolation and all below; no commands, no wing.
"""
