"""Poses from outside: the scene as files that any software reads, and the score of the poses that come back."""
