"""The command line: the only room that prints or exits.

============== ==================================================================
Module         Responsibility
============== ==================================================================
``program``    the list of commands, the options that all have, how a call begins
``commands``   the commands, a module for those that belong together
``inputs``     arguments that several commands share; what the help says of recordings
``execute``    run a stage, print its summary, exit statuses; - as a file
``process``    told to stop: say so, end the children, leave; closed and full streams
``reporter``   what goes to stderr: notes, warnings, progress
============== ==================================================================
"""

from beltid.cli.program import app, main

__all__ = ["app", "main"]
