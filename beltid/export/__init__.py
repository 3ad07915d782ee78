"""Export the contact law of a belt: an open law file, and input for other programs.

`law` is the contact law as one value, its JSON text and JSON Schema; `targets` has a line per
program, `templates` their files. A target receives as much of the law as it can represent; the rest
is simplified, and the file states the deviation from the law over the range of mu. This package
returns texts and bytes; it does not read or write files.
"""
