"""Where the console command begins: `info` of a file at once, all else by typer, which takes longer to start."""

import gc
import os
import sys
from io import TextIOWrapper
from pathlib import Path

from .plain import ends_in_words, show_info


def main() -> None:
    """Entry point of the console command."""
    # Matrices are small here; the room of more threads may be what is missing.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # Of terminals that lack a letter.
            stream.reconfigure(errors="replace")
    match sys.argv[1:]:
        # Of a file that can be read: what typer says of others, and of all else, is left to it.
        case ["info", file, *more] if {*more} <= {"--json"} and file[:1] != "-" and os.access(file, os.R_OK):
            # It ends before it is worth while to look for what is not used.
            gc.disable()
            ends_in_words(show_info)(Path(file), bool(more))
        case _:
            from .cli import app

            # Little of what is made refers to itself: ten times as rarely as usual is soon enough to look for that.
            gc.set_threshold(10_000)
            app(prog_name="flexfmu")
