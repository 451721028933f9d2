"""Build an FMU from a body file: `python build_fmu.py BODY.toml --output FILE.fmu` is `flexfmu build …`."""

import sys

from flexfmu.commands.cli import app

if __name__ == "__main__":
    app(["build", *sys.argv[1:]], prog_name="build_fmu.py")
