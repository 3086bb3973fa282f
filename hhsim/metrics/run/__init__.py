"""Figures of a run, a module a family: a new file with `METRICS` adds its figures everywhere."""
