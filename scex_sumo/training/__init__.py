"""Training of the learned drivers: samples from recordings, losses, the loop. Never loaded by ``run``.

May import behaviors, converters, extrapolation and all below; torch lives here.
"""
