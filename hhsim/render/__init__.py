"""Pictures of scenes and results, drawn without a display."""
