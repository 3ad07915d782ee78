"""The reference for stick and slip: complementarity problems, solved without guesses.

==============  ==================================================================  ==========
Module          Responsibility                                                      Equation
==============  ==================================================================  ==========
``lcp``         Lemke's method, independent of the active set                       (11), (12)
``step``        A step by Lemke's method on the Delassus matrix                     (12)
==============  ==================================================================  ==========
"""
