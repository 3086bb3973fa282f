"""Spheres for the links of a robot: built, measured, read and written."""
