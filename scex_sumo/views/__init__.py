"""Views of children in plain sumo-gui: replay files and floating car data.

May import world, results and all below; not behaviors.
"""
