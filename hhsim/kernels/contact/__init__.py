"""Contacts between the hand and a sphere tree."""
