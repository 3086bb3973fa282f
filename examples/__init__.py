"""Examples, copied by `hhsim examples`; README.md says what each shows."""
