"""Workers: the processes that run batches of children, and how work and results pass to and fro.

May import the job and what it runs, and all below; not the extrapolation of a whole seed scene.
"""
