"""Kernels of the live loop: its decisions in a tick, and the loop itself, without the interpreter."""
