"""`python -m flexfmu`: the same as `flexfmu`."""

from .commands.cli import main

main()
