"""``python -m mjhcmc``: the command line."""

from mjhcmc.cli import main

main()
