"""Parameters of commands: options and arguments that several of them share, and how groups of them are declared."""
