"""The `hhsim` command line: one thin module a command."""
