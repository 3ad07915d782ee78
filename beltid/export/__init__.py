"""Export the contact law of a belt: an open law file, and input for other programs.

A target receives as much of the law as it can represent. The rest is simplified, and the file
states the deviation from the law over the range of mu.

============= =========================================================
Module        Responsibility
============= =========================================================
``law``       the contact law as one value, its JSON text and JSON Schema
``targets``   a line per program; ``templates`` has its files; what is
              simplified, and the deviation from the law
============= =========================================================

This package returns texts and bytes; it does not read or write files.
"""
