"""The numerical experiment: the friction rig as a planar multibody model (Sections 3 and 4).

===================  =============================================================  ============
Module               Responsibility                                                 Equation
===================  =============================================================  ============
``rig``              Entry point: simulate one run or a campaign                    (6), (8)
``model``            Path, mesh, belt, pulley and supports of a run; the bench
``beam``             The belt: path, cable elements, forces, supports               (9), (10)
``contact``          Contact with the pulley: normal forces, friction               (1) to (4),
                                                                                    (11), (12)
``step``             Linearised rig, Newton's method, time stepping;                (10) to (12)
                     also a belt running over the pulley, for the drive
``steady``           Belt laid on and tightened; the limit of full sliding
``transient_run``    Schedule and results of a transient run
``profile``          Forces, speeds and tension along the arc                       (8)
``sensitivity``      Derivatives of the tensions with respect to mu
``reference``        The same step by Lemke's method, without an initial guess      (11), (12)
``banded``           Banded LU factorisation and solution
``compiled``         Compiler decorators and a self-repairing cache
``kernel_cache``     Location of compiled kernels; processes that compile ahead
``first_call``       Entry point of such a process
``compiled_laws``    :mod:`beltid.laws`, compiled for the kernels                   (1) to (9)
===================  =============================================================  ============
"""
