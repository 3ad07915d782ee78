"""How sure a result is: the law of propagation (GUM), its Monte Carlo check, and the validation.

==================== ===================================================== =====================
Module               Responsibility                                        Equation
==================== ===================================================== =====================
``sources``          what is not known exactly, how large, and which
                     results it touches together
``press_law``        errors of the press in the contact law                (3)
``measured``         reduced runs of a rig, with errors corrected          (5) to (8)
``campaign``         runs and the bench they are simulated on
``reduced``          uncertainties of runs of the rig and of press laws    JCGM 100 (10)
``published``        sensitivities of the published surface
``refined``          sensitivities of the refined surface, and what the    implicit derivative
                     runs show beside it
``bending``          bending stiffness that the runs ask for
``simulated``        uncertainty of simulated runs, alone and against
                     measured ones
``drive``            what the inputs of a drive leave open
``budget``           contributions named, compared and combined; those     JCGM 100 (10), (G.2b)
                     to the covariance of a surface
``monte_carlo``      the chain again with drawn errors, and where linear   JCGM 101
                     is not good enough
``agreement``        simulated less measured in units of its uncertainty   ASME V&V 20
==================== ===================================================== =====================
"""
