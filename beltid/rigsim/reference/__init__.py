"""Solve stick and slip as complementarity problems, the reference for the active-set method.

==============  ==================================================================  ==========
Module          Responsibility                                                      Equation
==============  ==================================================================  ==========
``lcp``         Lemke's method, independent of the active set                       (11), (12)
``step``        One step by Lemke's method on the Delassus matrix                   (12)
==============  ==================================================================  ==========
"""
