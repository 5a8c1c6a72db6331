"""Training the learned drivers: samples from recordings, losses, the training loop. Never loaded by ``run``."""
