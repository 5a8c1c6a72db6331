"""Human-like drivers: what they see, how they drive, how they differ; their guard."""
