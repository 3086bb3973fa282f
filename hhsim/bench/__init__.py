"""Suites that measure methods beside each other."""
