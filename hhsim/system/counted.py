"""Counts in messages."""

PLURALS = {"vertex": "vertices", "leaf": "leaves"}
"""Irregular plurals."""


def counted(count: int, noun: str) -> str:
    """Return a number with its noun, plural unless it is 1: "1 tick", "3,000 ticks"."""
    return f"{count:,} {noun if count == 1 else PLURALS.get(noun, f'{noun}s')}"
