"""The gallery's live bodies: all are valid, and pages of them open, answer and complain of nothing."""

import re
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from demo.live import BODIES

from chromium import Tab, browser
from flexfmu.body.recovery import surface_von_mises

PAGE = Path(__file__).parents[2] / "docs/figures/coil_spring.html"
WIDTHS = pytest.mark.parametrize(("width", "dark"), [(1400, False), (400, True)])


@pytest.mark.parametrize("name", BODIES)
def test_the_bodies_of_the_gallery_are_valid(name):
    body = BODIES[name]()
    assert body.spec.interface
    assert body.spec.free == (not body.spec.support)
    assert 0.09 < np.ptp(body.mesh.points, axis=0).max() < 2.0


@lru_cache
def built(name):
    return BODIES[name]().build(stress=True)


@lru_cache
def written(name, folder):
    return built(name).view(live=True).save(folder / f"{name}.html")


def opened(page, width, dark):
    """The page, awake and at rest."""
    tab = Tab(page, width, 800, dark)
    tab.until("document.body.dataset.live === 'yes'")
    assert tab.value("live.body.time") == 0.0
    assert tab.value("document.documentElement.scrollWidth") <= width
    return tab


@pytest.mark.slow
@WIDTHS
def test_the_page_of_the_docs_opens_and_answers(width, dark):
    browser()
    with opened(PAGE, width, dark) as tab:
        assert tab.value("$('bar').hidden && $('livePanel').hidden")
        # The supports are shown, and no pointer takes them.
        assert tab.value("DATA.marks.map(mark => mark.kind)") == ["interface", "support"]
        assert tab.value("live.markNow.length - live.ends.length") == 1
        tab.pull(10, -60)
        tab.until("Math.hypot(...live.motion.slice(0, 3)) > 0.01 && live.load && live.error !== null")
        assert not tab.value("$('bar').hidden")
        # The estimate and its bound stand beside each other, each by its name.
        assert tab.value("live.bound >= live.error && live.error > 0.0")
        assert re.fullmatch(r"deflection error [\d.]+\s%, bound [\d.]+\s%", tab.value("$('trust').innerText.trim()"))
        assert tab.said == []


@pytest.mark.slow
@WIDTHS
def test_a_leaf_of_shells_bends(tmp_path_factory, width, dark):
    browser()
    with opened(written("leaf", tmp_path_factory.getbasetemp()), width, dark) as tab:
        x, y = tab.pull(-80, 80)
        tab.until("Math.hypot(...live.motion.slice(0, 3)) > 0.03")
        tab.until("live.error < 0.01")
        tab.pointer("mouseReleased", x, y)
        assert tab.said == []


@pytest.mark.slow
@WIDTHS
def test_a_finger_pulls_and_colours_show_stress_and_error(tmp_path_factory, width, dark):
    browser()
    with opened(written("leaf", tmp_path_factory.getbasetemp()), width, dark) as tab:
        tab.ask("Emulation.setTouchEmulationEnabled", enabled=True)
        tab.until("matchMedia('(pointer: coarse)').matches")
        x, y = tab.place()
        tab.ask("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
        tab.ask("Input.dispatchTouchEvent", type="touchMove", touchPoints=[{"x": x - 80, "y": y - 80}])
        tab.until("Math.hypot(...live.motion.slice(0, 3)) > 0.03")
        tab.value("(() => { $('colour').value = STRESS; $('colour').dispatchEvent(new Event('change')); })()")
        tab.until("peak && peak[1] > 1e8")
        body = built("leaf")
        count = body.model.mode_count
        now = f"[live.read(), live.body.modes({count}), live.motion, live.stress()].slice(1).map(x => Array.from(x))"
        q, motion, stress = (np.array(part) for part in tab.value(now))
        np.testing.assert_allclose(body.core.motion(q).ravel(), motion, atol=1e-12)
        np.testing.assert_allclose(stress, surface_von_mises(body.model, q), rtol=1e-4, atol=1e-4 * stress.max())
        # The mark is where it is largest, and the colours end where the user says.
        assert tab.value("(shape(), live.stress()[peak[0]] === peak[1] && peak[1] === Math.max(...live.stress()))")
        assert tab.value("!$('limits').hidden && $('limits').innerText.includes('singular')")
        tab.value("(() => { $('limit').value = 50; $('limit').dispatchEvent(new Event('input')); })()")
        tab.until("$('ticks').lastChild.textContent === '50'")
        tab.value("(() => { $('colour').value = ERROR; $('colour').dispatchEvent(new Event('change')); })()")
        tab.until("!$('legend').hidden && live.errorTint === ERROR_TINTS[0] && colours[1] > 0.6 && colours[0] === 0")
        tab.ask("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        tab.until("live.pull === null")
        assert tab.said == []


@pytest.mark.long
@WIDTHS
def test_a_free_bar_tumbles_and_the_camera_goes_with_it(tmp_path_factory, width, dark):
    browser()
    with opened(written("bar", tmp_path_factory.getbasetemp()), width, dark) as tab:
        begin = tab.value("centre")
        x, y = tab.pull(0, 60 + 0.15 * width)
        tab.until("Math.abs(live.motion[11]) > 0.3")
        tab.pointer("mouseReleased", x, y)
        tab.until("Math.abs(live.motion[11]) > 1.5")
        assert np.linalg.norm(np.subtract(tab.value("centre"), begin)) > 0.02
        assert tab.said == []


@pytest.mark.long
@WIDTHS
def test_an_arch_refuses_to_snap_and_says_that_its_load_is_critical(tmp_path_factory, width, dark):
    browser()
    with opened(written("arch", tmp_path_factory.getbasetemp()), width, dark) as tab:
        # Pressed bit by bit, until it has nothing to say against the load but that.
        x, y = tab.pull(0, 0)
        for _ in range(400):
            y += 0.25 if width < 500 else 0.75
            tab.pointer("mouseMoved", x, y)
            tab.value("new Promise(then => setTimeout(then, 60))")
            if tab.value("live.refused !== ''"):
                break
        assert "critical load" in tab.value("$('refused').textContent")
        assert not tab.value("$('refused').hidden")
        assert tab.value("live.motion.every(Number.isFinite)")
        assert tab.said == []
