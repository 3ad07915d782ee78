"""Uncertainty of the results: law of propagation (GUM) and validation.

==================== ===================================================== =====================
Module               Responsibility                                        Equation
==================== ===================================================== =====================
``sources``          sources of error, their sizes, and the results that
                     share them
``press_law``        errors of the press in the contact law                (3)
``measured``         reduced runs of a rig, with errors corrected          (5) to (8)
``campaign``         runs and the bench they are simulated on
``reduced``          uncertainties of runs of the rig and of press laws    JCGM 100 (10)
``published``        sensitivities of the published surface
``refined``          sensitivities of the refined surface, and effects     implicit derivative
                     of the campaign that the runs show
``simulated``        uncertainty of simulated runs, and of their
                     difference from measured ones
``drive``            uncertainty of a drive's speed losses by its inputs
``budget``           contributions named, compared and combined;           JCGM 100 (10), (G.2b)
                     covariance of a surface by its causes
``agreement``        simulated minus measured over its uncertainty         ASME V&V 20
==================== ===================================================== =====================
"""
