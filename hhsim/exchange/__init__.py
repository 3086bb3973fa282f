"""The hand in the formats of other software: URDF, MJCF."""
