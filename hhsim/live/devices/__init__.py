"""Gloves, one module each: name, settings and the driver to import."""
