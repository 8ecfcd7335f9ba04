"""`python -m softfuse` is the command `softfuse`."""

from softfuse.cli import main

if __name__ == "__main__":
    main()
