"""Where the palm is while a session runs."""
