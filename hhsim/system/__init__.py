"""What the operating system gives: files, environment, signals, threads."""
