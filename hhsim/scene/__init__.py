"""A scene: hands with their motions, and bodies, in one world."""
