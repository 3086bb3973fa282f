"""A session from start to file: its processes, recorder and viewer."""
