"""Pages looked at in Chromium without a window: what they draw and what they complain of."""

import re
import shutil
import subprocess

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


def look(page, picture, width, height=800):
    """Draw a page to a picture; its pixels (height, width, 3) in 0 … 1, and what the console said."""
    done = subprocess.run(
        [
            browser(),
            "--headless=new",
            "--no-sandbox",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            "--hide-scrollbars",
            "--enable-logging=stderr",
            f"--user-data-dir={picture.parent / 'profile'}",
            f"--window-size={width},{height}",
            "--virtual-time-budget=2000",
            f"--screenshot={picture}",
            page.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    said = re.findall(r"CONSOLE[^\]]*\] (.*)", done.stderr)
    return np.asarray(matplotlib.image.imread(picture))[:, :, :3], said
