"""Training the learned drivers: samples from recordings, losses, the loop. Never loaded by ``run``."""
