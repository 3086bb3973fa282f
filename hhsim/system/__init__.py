"""Operating system: files, environment, signals, threads."""
