"""Steps of a run, from its options to its page, and the commands around them.

May import everything except studies and what builds on them.
"""
