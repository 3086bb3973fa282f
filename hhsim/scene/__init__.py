"""A scene: an object, a hand and a motion between them."""
