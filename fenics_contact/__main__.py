"""`python3 -m fenics_contact`."""

import sys

from fenics_contact.cli.command_line import main

if __name__ == "__main__":
    sys.exit(main())
