"""Press test: from a recording of force over travel to the normal contact law.

=============  ======================================================================  ============
Module         Responsibility                                                          Equation
=============  ======================================================================  ============
recording      settings; clean a test, find cycles and the curve midway between branches
stiffness      the quadratic law, with free contact points, per temperature, pooled    Eqs. (1), (3)
=============  ======================================================================  ============
"""
