"""The trajectory catalogue: TOML scripts and small recordings."""
