"""Sphere trees of objects: builders, files, and how far each is off its mesh."""
