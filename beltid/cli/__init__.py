"""The command line: the only package that prints or exits.

`program`: commands from functions and steps, and the entry point. `commands`: those that are no
steps. `execute`: options of all, work, messages, result, exit statuses, stop signals, streams.
"""

from beltid.cli.program import app, main

__all__ = ["app", "main"]
