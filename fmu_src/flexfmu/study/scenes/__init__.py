"""Scenes: what a body goes through, how well each model of it does there, what it costs, and which one is enough."""
