"""What the default leaves of the twisted cantilever: frames, modes and shapes of third order, one at a time.

``python -m benchmarks.defaults.twisted`` keeps ``twisted.csv``: error of the tip's displacement by part of the load.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from unittest.mock import patch

import numpy as np

from benchmarks.defaults.measure import reference
from benchmarks.defaults.published import twisted_cantilever
from benchmarks.records import write_records
from flexfmu.body.flexible_body import FlexibleBody
from flexfmu.build.config import read_body_file
from flexfmu.build.reduce import reduce_body
from flexfmu.files.outputs import Reporter
from flexfmu.reduction import basis
from flexfmu.study.scene.reference import by_default

RECORDS = Path(__file__).with_name("twisted.csv")
# What is changed: frames, normal modes, the threshold of shapes of third order, and how many there may be.
CHANGES: dict[str, tuple[int | None, int | None, float, int]] = {
    "default": (None, None, 0.01, 6),
    "1 frame": (1, None, 0.01, 6),
    "16 frames": (16, None, 0.01, 6),
    "16 modes": (None, 16, 0.01, 6),
    "20 modes": (None, 20, 0.01, 6),
    "20 shapes of third order": (None, None, 0.01, 20),
    "twice their threshold": (None, None, 0.02, 6),
    "a tenth of their threshold": (None, None, 0.001, 6),
}


def main() -> int:
    """Build, compare, and keep a row a change."""
    body, rows = twisted_cantilever(), []
    exact = reference(body)
    with tempfile.TemporaryDirectory() as top:
        config = read_body_file(body.write(Path(top)))
        for what, (levels, modes, least, most) in CHANGES.items():
            with patch.multiple(basis, _LEAST=least, _MOST=(most, 2)):
                reduced = reduce_body(by_default(config, modes=modes, error=False), Reporter(), levels=levels)
            model = FlexibleBody(reduced)
            row: dict[str, object] = {"what": what, "frames": reduced.frame_count, "coordinates": reduced.mode_count}
            for (case, share), expected in exact.items():
                loads = {name: [float(share) * size for size in force] for name, force in body.cases[case].items()}
                off = model.response(model.static(loads)).displacement[0] - expected[0, :3]
                row[f"error_at_{share}"] = f"{np.linalg.norm(off) / np.linalg.norm(expected[0, :3]):.3g}"
            rows.append(row)
            print(*(f"{key} {value}" for key, value in row.items()), sep=", ", flush=True)
    write_records(RECORDS, rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
