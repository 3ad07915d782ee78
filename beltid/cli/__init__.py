"""The command line: the only package that prints or exits.

`program`: commands from functions and steps, the options of all, the entry point. `commands`: those
that are no steps. `execute`: work, messages, result, exit statuses. `process`: stop signals and
streams.
"""

from beltid.cli.program import app, main

__all__ = ["app", "main"]
