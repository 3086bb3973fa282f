"""Gloves that are programs, to try a session against."""
