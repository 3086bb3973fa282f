"""Ticks of free bodies and of hands that might meet: one program of all, with friction and a table."""
