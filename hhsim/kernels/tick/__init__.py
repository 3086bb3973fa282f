"""One tick of each method, and blocks of ticks."""
