"""The command line: the only package that prints or exits.

============== ==================================================================
Module         Responsibility
============== ==================================================================
``program``    the list of commands, the options that all have, the entry point
``commands``   the commands, grouped into modules by topic
``inputs``     arguments that several commands share; recordings in the help
``execute``    run a stage, print its summary, exit statuses
``process``    stop signals: report, end the children, exit; closed and full streams
``reporter``   what goes to stderr: notes, warnings, progress
============== ==================================================================
"""

from beltid.cli.program import app, main

__all__ = ["app", "main"]
