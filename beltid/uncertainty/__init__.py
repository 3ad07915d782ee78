"""How sure a result is: the law of propagation (GUM), its Monte Carlo check, and the validation.

================ =========================================================================
Module           Responsibility
================ =========================================================================
``sources``      what is not known exactly, how large, and which results it touches together
``press_law``    errors of the press in the coefficients of the contact law
``measured``     reduced runs of a rig, and the same with errors corrected
``reduced``      combined uncertainties of runs of the rig and of press laws
``campaign``     the same for the runs together with the bench they are simulated on
``refined``      sensitivities of the refined surface
``published``    the same for the surface of the published procedure
``surface``      covariance of a surface by its causes, as columns and a budget
``simulated``    what is not known of simulated runs, alone and against measured ones
``budget``       contributions named, compared and combined
``monte_carlo``  the chain again with drawn errors (JCGM 101)
``linear_check`` where the law of propagation is not good enough
``drive``          what the inputs of a drive leave open of its speed losses
``agreement``      a comparison with its validation and its budget, run by run
``validation``   simulated less measured, in units of its uncertainty (ASME V&V 20)
================ =========================================================================
"""
