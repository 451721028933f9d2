"""A scene: what a body goes through, what is true there, and how far a model is off."""
