"""Statistics of samples: densities, intervals, designs, paired tests. Arrays in, arrays out.

May import base alone.
"""
