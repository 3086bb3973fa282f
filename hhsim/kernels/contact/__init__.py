"""Contacts between the hand and a surface."""
