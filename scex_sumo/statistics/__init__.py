"""Statistics of samples: densities, intervals, designs, distances, effects. Arrays in, arrays out.

May import arrays and errors alone.
"""
