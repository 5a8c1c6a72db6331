"""Exporters: futures and their road in the formats of other simulators."""
