"""Rules of the road for drivers: passages on their paths, where they must stop, and motion across lanes."""
