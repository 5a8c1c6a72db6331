"""Drawing of the example maps that the package ships; not needed to use them.

May import geometry and scenarios.traffic.
"""
