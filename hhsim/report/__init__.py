"""One HTML page of results."""
