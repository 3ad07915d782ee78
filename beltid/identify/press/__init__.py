"""Press test: from a recording of force over travel to the normal contact law.

=============  ==============================================================  ==================
Module         Responsibility                                                  Equation
=============  ==============================================================  ==================
recording      settings; clean a test, fix its signs, zero it, find cycles
curves         read a recording; branches of a cycle, and the curve midway between
fit            fitter for all normal laws, with a free contact point per test    Eq. (3)
stiffness      complete evaluation: quadratic law per temperature and pooled        Eqs. (1), (3)
temperature    F test of one law against one per temperature
checks         errors beyond scatter: misfit, loading only, virgin rubber, rate
laws           comparison of linear, quadratic, power and cubic law                 Eq. (3)
dissipation    estimate of C_P from the hysteresis                              Eqs. (2), (4)
=============  ==============================================================  ==================
"""
