"""What is measured, each figure defined once, and the brute force behind it."""
