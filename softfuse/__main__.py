"""`python -m softfuse` is the command `softfuse`."""

from softfuse.cli.app import main

main()
