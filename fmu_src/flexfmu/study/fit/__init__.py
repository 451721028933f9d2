"""The search for the smallest model: what is tried, frames, modes, reasons, and what is delivered."""
