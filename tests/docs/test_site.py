"""The site is whole on the disk: its pages fetch nothing, and its search works there."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
BROWSER = shutil.which("chromium") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    if importlib.util.find_spec("mkdocs") is None:
        pytest.skip("mkdocs is not installed")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    )
    assert done.returncode == 0, done.stderr
    return folder


def test_pages_load_nothing_from_the_network(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 20
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert re.findall(r"<(?:script|img|iframe)[^>]*\ssrc=\"?(?:https?:)?//[^>]*>", text) == [], page.name
        assert re.findall(r"<link[^>]*\shref=\"?(?:https?:)?//[^>]*>", text) == [], page.name


@pytest.mark.skipif(BROWSER is None, reason="no Chromium")
@pytest.mark.parametrize("page", ["index.html", "reference/body-file.html"])
def test_search_works_on_pages_opened_from_the_disk(site, page):
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=20000", "--dump-dom"]
    command = [BROWSER, *options, f"file://{site / page}?q=compliance"]
    shown = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120).stdout
    found = re.search(r"md-search-result__meta\">(\d+) matching", shown)
    assert found is not None
    assert int(found[1]) > 3
    assert "h=compliance" in shown
