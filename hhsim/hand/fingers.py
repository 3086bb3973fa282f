"""The fingers of a hand and their parts, in the order of every array."""

FINGERS = ("thumb", "index", "middle", "ring", "little")
PHALANGES = 3
"""Of each finger, proximal to distal; the thumb's metacarpal counts as its first."""
BODIES = PHALANGES * len(FINGERS) + 1
"""What can touch: every phalanx, finger by finger, and the palm."""
