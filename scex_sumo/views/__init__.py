"""Views of children in plain sumo-gui.

May import world, results and all below; not behaviors.
"""
