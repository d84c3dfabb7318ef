"""Console scripts: the program, and the one that estimates depth."""

import sys


def main() -> None:
    """Runs the command line of this process as that of the program."""
    from . import _core

    sys.exit(_core.run_program(sys.argv))


def estimate_depth() -> None:
    """Runs estimate_depth, which needs Pillow."""
    try:
        from . import estimate_depth as program
    except ImportError as error:
        sys.exit(f"{error}; install it by: pip install 'dgsfm[depth]'")
    program.main()


if __name__ == "__main__":
    main()
