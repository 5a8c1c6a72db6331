"""Conflicts: who has to brake for whom and how hard, how closely two vehicles pass, and P of a contact."""
