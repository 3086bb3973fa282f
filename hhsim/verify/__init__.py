"""Referee: every claim of a result checked by other code."""
