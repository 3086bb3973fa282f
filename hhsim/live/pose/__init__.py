"""Sources of the palm's pose during a session."""
