"""Poses from outside: scenes as files for any software, and the score of what comes back."""
