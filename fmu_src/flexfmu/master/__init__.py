"""A co-simulation master for FMI 2.0 FMUs, of ours and of other origin; docs/master.md tells how to use it."""

from .config import CouplingFile, parse_coupling, read_coupling_file
from .coupling import Result, couple, run, write_result, write_ssp

__all__ = [
    "CouplingFile",
    "Result",
    "couple",
    "parse_coupling",
    "read_coupling_file",
    "run",
    "write_result",
    "write_ssp",
]
