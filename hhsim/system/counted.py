"""Counts in texts for people."""

PLURALS = {"vertex": "vertices", "leaf": "leaves"}
"""Of nouns that do not take an s."""


def counted(count: int, noun: str) -> str:
    """A number with its noun, in the plural where it is not 1: "1 tick", "3,000 ticks"."""
    return f"{count:,} {noun if count == 1 else PLURALS.get(noun, f'{noun}s')}"
