"""The active-set solver."""
