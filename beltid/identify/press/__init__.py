"""Press test: from a recording of force over travel to the normal contact law.

=============  ======================================================================  ============
Module         Responsibility                                                          Equation
=============  ======================================================================  ============
recording      settings; clean a test, fix its signs, zero it, find cycles
curves         read a recording; branches of a cycle, and the curve midway between
law            the quadratic law of several curves, with free contact points           Eq. (3)
stiffness      complete evaluation: the law per temperature and pooled                 Eqs. (1), (3)
=============  ======================================================================  ============
"""
