"""The hand: frustums, kinematics, closing fingers."""
