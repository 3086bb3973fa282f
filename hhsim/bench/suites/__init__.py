"""Suites of `hhsim bench`: a module each, with its `SUITE`; its docstring's first line is that of the help."""
