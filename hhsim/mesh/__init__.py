"""Triangle meshes: files, repair, generators, and the catalogue of objects."""
