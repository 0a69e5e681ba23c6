"""``python -m bumpstop``: the command, where its script is not on the path."""

from bumpstop.cli.main import main

main()
