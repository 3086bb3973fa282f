"""Spheres for robots, on the command line."""
