"""The loop of a session, and what frees the fingers when it fails."""
