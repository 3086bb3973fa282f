"""Yes or no to a change: errors, work and time against a baseline."""
