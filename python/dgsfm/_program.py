"""The program as a console script."""

import sys


def main() -> None:
    """Runs the command line of this process as that of the program."""
    from . import _core

    sys.exit(_core.run_program(sys.argv))


if __name__ == "__main__":
    main()
