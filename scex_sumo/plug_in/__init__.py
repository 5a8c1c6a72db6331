"""Plug-ins: users' models by import path, function or file, and the fallback planner."""
