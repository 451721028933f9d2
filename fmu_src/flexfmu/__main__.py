"""`python -m flexfmu`: the same as `flexfmu`."""

from .cli import main

main()
