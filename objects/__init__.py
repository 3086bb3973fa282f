"""The object catalogue: meshes and one TOML each (source, licence, unit, scale, what it stresses)."""
