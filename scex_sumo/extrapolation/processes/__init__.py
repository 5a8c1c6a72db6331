"""Worker processes of a run and of a study, and the pool that hands them work."""
