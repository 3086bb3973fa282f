"""The tick of an object that is free: hand and object in one program, with friction and a table."""
