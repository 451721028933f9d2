"""`python -m flexfmu`: the same as `flexfmu`."""

from .commands.entry import main

# A process that is started beside it imports this module, too.
if __name__ == "__main__":
    main()
