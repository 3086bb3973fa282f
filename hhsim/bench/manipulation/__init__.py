"""`hhsim bench manipulation`: known answers of free objects with friction, and a pinch beside another engine."""
