"""The command line: the only room that prints or exits.

============ ================================================
Module       Responsibility
============ ================================================
``app``      the commands and their help
``common``   options that every command has
``execute``  run a stage, print its summary, exit statuses
``signals``  being told to stop by the system
``streams``  closed and full standard streams
``talk``     what goes to stderr: notes, warnings, progress
============ ================================================
"""

from beltid.cli.app import app, main

__all__ = ["app", "main"]
