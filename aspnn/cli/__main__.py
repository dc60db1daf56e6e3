"""`python -m aspnn.cli`."""

from aspnn.cli import main

main()
