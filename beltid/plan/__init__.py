"""Which runs of the friction rig to make next, and when to stop.

================ ============================================================= ================
Module           Responsibility                                                Equation
================ ============================================================= ================
``design``       what runs would teach; choice of the best ones                (P1) to (P4)
``prior``        the surface before any run, and between what was measured     (P5)
``present``      what is known before the runs, and the errors they share
``candidates``   settings of the rig as rows of the linear model               (P1), (P6)
``target``       where the surface has to be known, and regions of it          (P3)
``advice``       what the runs bring, what remains, whether to stop            (P3)
``session``      order of the runs, minutes
================ ============================================================= ================

The equations are those of the page on theory, section "Planning the next runs".
"""
