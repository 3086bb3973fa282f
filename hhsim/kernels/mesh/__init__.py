"""Triangle meshes: distance, inside and outside, clipping."""
