"""Memory and settings shared by the processes of a session."""
