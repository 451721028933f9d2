"""CalculiX and Abaqus decks."""
