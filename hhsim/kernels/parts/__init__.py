"""Bodies that move as recorded: the surface of all of them, and ticks of a hand that gives way."""
