"""Networks of the learned drivers in torch; `behaviors.learned.networks` runs them."""
