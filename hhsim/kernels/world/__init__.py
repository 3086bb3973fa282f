"""Ticks of hands and bodies: one program of all, with friction and a table where bodies move."""
