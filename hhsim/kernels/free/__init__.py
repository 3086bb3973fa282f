"""Tick of a free object: hand and object in one program, with friction and a table."""
