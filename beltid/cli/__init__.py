"""The command line: the only room that prints or exits.

============== ================================================
Module         Responsibility
============== ================================================
``app``        how a call begins and ends
``program``    the help of the program and the list of its commands
``commands``   the commands, a module for those that belong together
``inputs``     arguments that several commands share
``recordings`` what the help says about recordings
``common``     options that every command has
``execute``    run a stage, print its summary, exit statuses
``piping``     - in the place of a file: stdin, stdout
``explain``    pages about errors, found by a code
``signals``    told to stop: say so, end the children, leave
``streams``    closed and full standard streams
``reporter``   what goes to stderr: notes, warnings, progress
============== ================================================
"""

from beltid.cli.app import app, main

__all__ = ["app", "main"]
