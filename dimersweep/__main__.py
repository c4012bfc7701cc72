"""``python -m dimersweep`` is the command line."""

from dimersweep.cli import main

main()
