"""What the processes of a session share."""
