"""The press: from a recording of force over travel to the normal contact law.

=============  ==============================================================  ==================
Module         Responsibility                                                  Equation
=============  ==============================================================  ==================
recording      settings; clean a test, turn its signs, zero it, find cycles
curves         branches of a cycle, and the curve half-way between them
fit            the fitter of all normal laws, a free contact point per test    Eq. (3)
stiffness      the quadratic law per temperature and pooled: the recipe        Eqs. (1), (3)
temperature    F test of one law against one per temperature
checks         what scatter does not show: misfit, loading only, virgin, rate
laws           linear, quadratic, power and cubic law compared                 Eq. (3)
dissipation    what the hysteresis says about C_P                              Eqs. (2), (4)
=============  ==============================================================  ==================
"""
