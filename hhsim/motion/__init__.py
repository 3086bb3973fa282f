"""Trajectories of a hand: files, checks, and resampling to ticks."""
