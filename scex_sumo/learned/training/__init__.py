"""Training of the learned drivers: samples from recordings, losses, the loop. Only this wing loads torch."""
