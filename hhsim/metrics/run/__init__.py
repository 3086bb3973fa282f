"""Figures of a run, a module a family: a new file with `METRICS` adds its figures everywhere."""

ORDER = ("contact", "force", "free_object", "input_hand", "ticks")
"""Modules in the order of the table; any other comes after them."""
