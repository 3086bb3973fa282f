"""Figures of a run, a module a family: a new file with `METRICS` adds its figures everywhere."""

ORDER = ("contact", "force", "free_object", "energy", "input_hand", "tick_time", "work", "stuck_and_lag")
"""Modules in the order of the table; any other comes after them."""
