"""Networks of the learned drivers as they are trained, in torch; `behaviors.learned.networks` runs them."""
