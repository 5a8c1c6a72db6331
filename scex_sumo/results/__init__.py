"""Result folder: written whole or not at all, resumed, read back as a run.

May import metrics, statistics, scene and all below; not world, behaviors.
"""
