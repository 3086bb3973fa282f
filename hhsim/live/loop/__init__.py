"""Loop of a session, its driver and its watchdog."""
