"""Page of a run: its contents, tables and cards."""
