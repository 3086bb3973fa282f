"""Formats of the spheres of a robot: a module for each."""
