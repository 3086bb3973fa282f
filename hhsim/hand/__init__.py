"""The hand: sizes, palm, forward kinematics."""
