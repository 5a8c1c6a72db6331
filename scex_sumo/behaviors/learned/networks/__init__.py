"""Networks of the learned drivers as they run, in NumPy; `scex_sumo.training.networks` trains them.

May import behaviors.learned.seen, behaviors.scene_graph and all below; no torch.
"""
