"""python -m dgsfm COMMAND: the program."""

from ._program import main

main()
