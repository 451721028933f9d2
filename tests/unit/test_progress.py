"""What long jobs say while they run, and how Ctrl-C ends them."""

import io
import os
import re
import signal
import time

import pytest
from rich.console import Console

from flexfmu.files.console import ConsoleReporter
from flexfmu.files.outputs import (
    Reporter,
    Stages,
    duration_words,
    ends_on_interrupt,
    keeps_interrupts,
    progress_words,
)


class _Clock:
    """Seconds that pass as told."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_time_left_is_what_the_rest_takes_at_the_mean_pace():
    assert progress_words(3.0, 12.0, "models", 30.0) == "3 of 12 models, 90 s left"
    assert progress_words(0.25, 1.0, "s", 60.0) == "0.25 of 1 s, 3 min left"
    # Nothing is known of the pace before something is done.
    assert progress_words(0.0, 12.0, "models", 30.0) == "0 of 12 models"


@pytest.mark.parametrize(("seconds", "words"), [(4.2, "4 s"), (119.0, "119 s"), (600.0, "10 min"), (5400.0, "1.5 h")])
def test_times_are_said_as_a_person_would(seconds, words):
    assert duration_words(seconds) == words


def test_a_file_gets_a_plain_line_now_and_then_and_no_bar():
    text, clock = io.StringIO(), _Clock()
    reporter = ConsoleReporter(Console(file=text, width=120), clock)
    with reporter.counted("Try models", 100, "models") as tell:
        for done in range(1, 101):
            clock.now += 0.25
            tell(done)
    lines = text.getvalue().splitlines()
    assert [line.strip() for line in lines] == [
        "40 of 100 models, 15 s left",
        "80 of 100 models, 5 s left",
        "✓ Try models 25.00 s",
    ]
    assert "\x1b" not in text.getvalue()


def test_a_terminal_shows_stages_within_stages():
    text, clock = io.StringIO(), _Clock()
    reporter = ConsoleReporter(Console(file=text, width=80, force_terminal=True, legacy_windows=False), clock)
    with reporter.counted("Finer near the front", 40, "models") as tell:
        for done in range(1, 41):
            with Stages(reporter).stage(f"Model {done} of a long name, one of many that differ from each other"):
                clock.now += 10.0
                # Of what tells no share, how long it has taken.
                reporter._lines.refresh()
            tell(done)
            reporter._lines.refresh()
    shown = text.getvalue()
    # Whole within 80 columns.
    assert "20 of 40 models, 3 min left" in shown
    assert re.search(r"Model 20 of a long name, .*… .*10 s", shown)
    assert shown.count("✓") == 41


def test_ctrl_c_is_noted_and_the_job_ends_where_it_asks():
    steps = 0
    with ends_on_interrupt(Reporter()) as pressed:
        for _ in range(10):
            steps += 1
            if steps == 3:
                os.kill(os.getpid(), signal.SIGINT)
            if pressed():
                break
    assert steps == 3


def test_a_second_ctrl_c_ends_at_once():
    before = signal.getsignal(signal.SIGINT)
    with ends_on_interrupt(Reporter()) as pressed:
        os.kill(os.getpid(), signal.SIGINT)
        assert pressed()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_a_ctrl_c_that_python_drops_ends_the_job_at_its_next_stage():
    class Dropping:
        """Python prints what rises here, and goes on."""

        def __del__(self):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.01)

    reporter, steps, before = ConsoleReporter(quiet=True), [], signal.getsignal(signal.SIGINT)

    def job():
        with reporter.counted("Models", 4, "models") as tell:
            for step in range(4):
                Dropping()
                steps.append(step)
                tell(step + 1)

    with pytest.raises(KeyboardInterrupt), keeps_interrupts():
        job()
    assert steps == [0]
    assert signal.getsignal(signal.SIGINT) is before
