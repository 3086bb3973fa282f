"""The figures of a run, a module a family. A new file here with `METRICS` adds its figures everywhere."""
