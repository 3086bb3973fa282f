"""A result or a session in the rerun viewer."""
