"""Guard around a model: the planned way stays, the speed on it becomes safe.

May import behaviors.driving and all below.
"""
