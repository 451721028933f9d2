"""Pages looked at in Chromium without a window: what they draw and what they complain of."""

import re
import shutil
import subprocess
import tempfile

import matplotlib.image
import numpy as np
import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome")


def browser():
    """Path of Chromium; the test is skipped where there is none."""
    for name in _NAMES:
        path = shutil.which(name)
        if path is not None:
            return path
    return pytest.skip("no Chromium here to look at the page with")


def opened(page, *words):
    """Open a page in Chromium without a window; what it wrote. It hangs once in a while: then it is begun anew."""
    left = 3
    while True:
        # A profile that another process has not let go of yet would be waited for.
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
            command = [browser(), "--headless=new", "--no-sandbox", f"--user-data-dir={profile}", *words, page.as_uri()]
            try:
                return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
            except subprocess.TimeoutExpired:
                left -= 1
                if not left:
                    raise


def look(page, picture, width, height=800):
    """Draw a page to a picture; its pixels (height, width, 3) in 0 … 1, and what the console said."""
    done = opened(
        page,
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
        "--hide-scrollbars",
        "--enable-logging=stderr",
        f"--window-size={width},{height}",
        "--virtual-time-budget=2000",
        f"--screenshot={picture}",
    )
    said = re.findall(r"CONSOLE[^\]]*\] (.*)", done.stderr)
    return np.asarray(matplotlib.image.imread(picture))[:, :, :3], said
