"""Bytes to and from a glove: TCP, UDP, and the formats on them."""
