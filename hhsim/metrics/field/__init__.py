"""Figures of repaired recordings as the field publishes them; every module says where its definition comes from."""

ORDER = ("depth", "volume", "contact", "correction", "finger_force")
"""Modules in the order of the table; any other comes after them."""
