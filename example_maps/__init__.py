"""Generator of the example seeds that the package ships: maps and recorded traffic. Not in the wheel.

Run as ``python -m example_maps.make_examples`` in a checkout.
"""
