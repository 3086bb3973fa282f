"""Measures of a run, each defined once, and brute force to check them."""
