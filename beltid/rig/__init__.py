"""The numerical experiment: the friction rig as a planar multibody model (Sections 3 and 4).

===============  ==============================================================  ============
Module           Responsibility                                                  Equation
===============  ==============================================================  ============
``mesh``         Path of the belt, mesh, shape functions
``belt``         Internal and inertia forces of the ANCF cable                   (9), (10)
``contact``      Normal forces and friction, point by point                      (1) to (4), (11)
``newton``       One equilibrium, its boundaries, the march in time              (10)
``lcp``          The same step as the paper's complementarity problem            (11), (12)
``model``        The bench, and the model of one run
``steady``       Belt laid on and tightened; the limit of full sliding
``transient``    Schedule and results of a run in time
``runs``         Entry point: one run or a campaign                              (6), (8)
``profile``      Forces, speeds and tension along the arc                        (8)
``sensitivity``  Exact derivatives of the tensions by the friction
``flow``         The belt flowing over a turning pulley, for the drive
``banded``       Banded LU factorisation and solution
``compiler``     Compiled kernels, cached by their sources
===============  ==============================================================  ============
"""
