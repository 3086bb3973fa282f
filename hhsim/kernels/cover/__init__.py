"""Covers of a surface by spheres, and their proofs."""
