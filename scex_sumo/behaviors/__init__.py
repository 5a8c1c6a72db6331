"""Behaviour models: who drives how."""
