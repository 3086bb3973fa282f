"""Whole evaluation of the paper."""
