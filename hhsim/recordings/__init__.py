"""Recordings of real hands, in other people's formats, made trajectories."""
