"""Hand: frustums, kinematics, closing fingers."""
