"""Reports for people: pictures and terminal tables. Only here: matplotlib.

May import studies, results and all below; not ranking, commands.
"""
