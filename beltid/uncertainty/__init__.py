"""Uncertainty of the results: law of propagation (GUM) and validation.

================ ========================================================== =====================
Module           Responsibility                                             Equation
================ ========================================================== =====================
``sources``      kinds of errors in a table, their sizes, and what one      JCGM 100 (10)
                 standard uncertainty of each changes
``budget``       contributions named, compared and combined;                JCGM 100 (10), (G.2b)
                 covariance of a surface by its causes
``measured``     reduced runs of a rig and contact law, errors corrected    (3), (5) to (8)
``reduced``      uncertainties of runs, press laws, the published surface
``rig_runs``     runs on the simulated rig, with derivatives by friction
                 and by the inputs of the rig
``simulated``    simulated runs, and their difference from measured ones
``drive``        speed losses of a drive: solved again with each error
``agreement``    simulated minus measured over its uncertainty              ASME V&V 20
================ ========================================================== =====================

The refined surface (:mod:`beltid.refine`) and the plan (:mod:`beltid.plan`) propagate with the same
sources.
"""
