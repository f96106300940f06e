"""The command line, and what its commands do."""

from fenics_contact.cli.command_line import main

__all__ = ["main"]
