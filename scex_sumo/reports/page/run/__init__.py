"""Report of a run: what its page shows, from the result folder, and the HTML that stands in it.

May import results and all below, and the components beside this folder; nothing from studies or commands.
"""
