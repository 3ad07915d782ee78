"""The numerical experiment: the friction rig as a planar multibody model (Section 4).

===================  =============================================================  ============
Module               Responsibility                                                 Equation
===================  =============================================================  ============
``rig``              Front door: one run, or a campaign of runs                     (6), (8)
``model``            Path, mesh, belt, pulley and supports of a run; the bench
``beam``             The belt: path, cable elements, forces, supports               (9), (10)
``contact``          Its contact with the pulley: normal forces, friction           (1) to (4),
                                                                                    (11), (12)
``step``             Linearised rig, Newton's method, march from step to step;      (10) to (12)
                     a belt that runs over the pulley, for the drive
``steady``           Belt laid on and tightened; the limit of full sliding
``transient_run``    Schedule of a run in time, and what comes of it
``profile``          Forces, speeds and tension along the arc                       (8)
``sensitivity``      Derivatives of the tensions with respect to mu
``reference``        The same step by Lemke's method, independent of all guesses    (11), (12)
``banded``           Banded LU factorisation and solution
``compiled``         The compiler's decorators, and a cache that heals
``kernel_cache``     Where compiled kernels are kept; processes that compile ahead
``first_call``       What such a process calls
``compiled_laws``    :mod:`beltid.laws`, compiled for the kernels                   (1) to (9)
===================  =============================================================  ============
"""
