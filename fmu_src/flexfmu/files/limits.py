"""Sizes beyond which a job is refused before it begins: it would take days, or more memory than there is."""

MOST_MODES = 1000
"""Normal modes of a body."""
MOST_FRAMES = 1000
"""Frames, or levels of them."""
MOST_STEPS = 1_000_000
"""Communication steps that every model of a scene takes."""
MOST_COUPLED_STEPS = 100_000_000
"""Communication steps of a coupling: of the smallest FMUs they take hours."""
MOST_VALUES = 5e7
"""Results that a run of FMUs keeps, rows times columns: some 2 GB while it runs."""
