"""Many replays by one plan: objects, motions, methods, surfaces and options, in processes or on a cluster."""
