"""Example maps that the package ships: their drawing, and the recording of their traffic; not in the package.

Run as ``python -m example_maps.make_examples`` in a checkout.
"""
