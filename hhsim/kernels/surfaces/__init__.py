"""Surfaces that objects can have: one module each, which declares `SURFACE`."""
