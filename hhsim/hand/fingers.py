"""Fingers of a hand and their bodies, in the order of every array."""

FINGERS = ("thumb", "index", "middle", "ring", "little")
PHALANGES = 3
"""Phalanges of each finger, proximal to distal; the thumb's metacarpal counts as its first."""
PHALANX_NAMES = ("proximal", "middle", "distal")
"""Names of a finger's phalanges."""
BODIES = PHALANGES * len(FINGERS) + 1
"""Bodies that can touch: every phalanx, finger by finger, and the palm."""
