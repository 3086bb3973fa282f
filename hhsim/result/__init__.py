"""The result file: its schema, and how it is written and read."""
