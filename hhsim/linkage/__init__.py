"""Rigid links on joints as URDF and MJCF describe them."""
