"""The command line: the only package that prints or exits.

============== ==================================================================
Module         Responsibility
============== ==================================================================
``program``    the list of commands, the options that all have, the entry point
``commands``   the commands that are no steps of the method
``steps``      a command from a step: arguments and options by its signature
``execute``    do the work, print its summary, exit statuses
``process``    stop signals: report, end the children, exit; closed and full streams
``messages``   what goes to stderr: notes, warnings, progress
============== ==================================================================
"""

from beltid.cli.program import app, main

__all__ = ["app", "main"]
