"""The contact law of a belt for multibody codes: one open file of our own, and what others read.

A target gets as much of the law as it can hold. What it cannot hold is replaced by something
simpler, and the file says how far that is from the law over its measured range.

================= ===================================================================
Module            Responsibility
================= ===================================================================
``law``           the contact law as one value: the model of the JSON file
``law_file``      JSON text <-> law; the JSON Schema
``reduction``     simpler laws, and how far they are from the law
``choices``       units (SI, or millimetre and newton), reference point; the files
``preamble``      the comment that every file begins with
``targets``       what can be written, by name
``python_text``   Exudyn and Project Chrono modules
``compiled_text`` C, Fortran; user subroutines of MBDyn, RecurDyn, Adams, MotionSolve
``solver_text``   MBDyn, Adams, Abaqus
``table_text``    Modelica, MATLAB, CSV
================= ===================================================================

This room makes texts and bytes; it reads and writes no file.
"""
