"""A run: every tick of a scene, its file, and what the file says in short."""
