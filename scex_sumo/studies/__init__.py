"""Studies of finished runs: compare, explain, how many children are enough.

May import extrapolation, results, statistics and all below; not reports.
"""
