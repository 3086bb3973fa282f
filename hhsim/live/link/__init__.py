"""Bytes to and from a glove: serial lines, TCP, UDP, and the formats on them."""
