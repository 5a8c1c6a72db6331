"""Pages of the studies: compare, explain, sample size; each one file in the shell of `reports.page`.

May import studies, results and all below, and reports' page; no matplotlib, nothing from commands.
"""
