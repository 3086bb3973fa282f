"""The hand and the scene in the formats of other software."""
