"""Export the contact law of a belt: an open law file, and input for multibody codes.

A target receives as much of the law as it can represent. The rest is simplified, and the file
states the deviation from the law over the range of mu.

================= ===================================================================
Module            Responsibility
================= ===================================================================
``law``           the contact law as one value: the model of the JSON file
``law_file``      JSON text <-> law; the JSON Schema
``reduction``     simplified laws and their deviation from the law
``choices``       units (SI, or millimetre and newton), reference point; the files
``preamble``      comment at the start of every file
``targets``       table of the targets by name
``python_text``   Python modules: numpy alone, Exudyn
``compiled_text`` C, Fortran
``table_text``    Adams, Modelica, MATLAB, CSV
================= ===================================================================

This package returns texts and bytes; it does not read or write files.
"""
