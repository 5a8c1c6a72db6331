"""Networks of the learned drivers in torch; `behaviors.learned.network.networks` runs them."""
