"""The command line: the only package that prints or exits.

`program`: commands are made from functions; the options of all; the entry point. `commands`: those
that are no steps. `steps`: a command from a step. `execute`: work, summary, exit statuses.
`process`: stop signals and streams. `messages`: notes, warnings and progress on stderr.
"""

from beltid.cli.program import app, main

__all__ = ["app", "main"]
