"""Networks of the learned drivers as they are trained, in torch; `behaviors.learned.networks` runs them.

May import behaviors.learned and all below.
"""
