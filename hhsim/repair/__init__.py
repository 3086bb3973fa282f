"""Repair of recorded hands: the same recording without penetration, in its own format, with the field's figures."""
