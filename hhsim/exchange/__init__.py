"""Export of the hand to URDF and MJCF."""
