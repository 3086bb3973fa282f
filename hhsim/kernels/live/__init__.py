"""The decisions of a live loop's tick, and the loop itself, with no interpreter in it."""
