"""Drivers: how each glove is spoken to. Imported when a glove is opened."""
