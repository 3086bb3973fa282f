"""Compiled kernels: arrays and NamedTuples of arrays in, status codes out; no I/O and no exceptions."""
