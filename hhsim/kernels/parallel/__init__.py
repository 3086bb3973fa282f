"""Threads inside a tick."""
