"""Hand: sizes, palm, forward kinematics."""
