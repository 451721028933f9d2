"""Modes by formula become an FMU's body: a clamped beam of 1 m × 20 mm × 20 mm, without any mesh.

Run from the repository's root: python -m demo.given_modes [FILE.npz].
"""

import sys
from pathlib import Path

import numpy as np

import flexfmu

# Three bending modes in y, on a row of sections.
x = np.linspace(0.0, 1.0, 41)
corners = [(y, z) for y in (-0.01, 0.01) for z in (-0.01, 0.01)]
nodes = np.array([(a, y, z) for a in x for y, z in corners])
weight = np.full(41, 1.0 / 40) * np.where((x == 0.0) | (x == 1.0), 0.5, 1.0)
modes, frequency = [], []
for beta in (1.87510407, 4.69409113, 7.85475744):
    ratio = (np.cosh(beta) + np.cos(beta)) / (np.sinh(beta) + np.sin(beta))
    b = beta * nodes[:, 0]
    bend = np.cosh(b) - np.cos(b) - ratio * (np.sinh(b) - np.sin(b))
    slope = beta * (np.sinh(b) + np.sin(b) - ratio * (np.cosh(b) - np.cos(b)))
    modes.append(np.stack([-nodes[:, 1] * slope, bend, 0.0 * b], axis=1))
    frequency.append(beta**2 / (2.0 * np.pi) * np.sqrt(2.1e11 * 0.02**2 / 12.0 / 7850.0))
sets = {"TIP": np.flatnonzero(nodes[:, 0] == 1.0)}
given = flexfmu.GivenModes(nodes, modes, frequency, np.repeat(weight, 4) * 7850.0 * 0.02**2 / 4.0, sets, name="beam")
target = Path(sys.argv[1] if len(sys.argv) > 1 else "output/beam.npz")
target.parent.mkdir(parents=True, exist_ok=True)
given.save(target)
body = flexfmu.pack(given, {"tip": "TIP"})
print(body.response(body.static({"tip": [0.0, 10.0, 0.0]})).displacement[0, 1])
