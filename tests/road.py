"""The rear axle's road in processes of their own, since FMUs end up in the one that runs them."""

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
MARK = "RESULT "
BUILD = """
import sys
from pathlib import Path
from demo.rear_axle.road.scene import Ride, build_axle, build_wheel, coil_preload
from flexfmu.files.outputs import Reporter

folder = Path(sys.argv[1])
body = build_axle(folder, Reporter())
build_wheel(folder)
print("RESULT", coil_preload(body, Ride()))
"""


def python(code, *arguments, cache=""):
    """What code prints as its result; modes that it finds are kept in the folder `cache`, if there is one."""
    command = [sys.executable, "-c", code, *map(str, arguments)]
    environment = {**os.environ, "FLEXFMU_CACHE": str(cache)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False, cwd=ROOT, env=environment)
    lines = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    assert lines, done.stderr
    return json.loads(lines[-1].removeprefix(MARK))


def built(folder, cache=""):
    """Build the FMUs of axle and wheel in a folder; return what the coil springs bear before, N."""
    return python(BUILD, folder, cache=cache)
