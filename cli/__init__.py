"""Command line `hhsim`: one thin module a command."""
