"""Pictures: densities, scenes, groups of runs, as figures and files. Only here: matplotlib.

May import the terminal tables, studies, results and all below.
"""
