"""Choose the next runs of the friction rig, and decide when to stop.

============== ================================================================ ================
Module         Responsibility                                                   Equation
============== ================================================================ ================
``design``     expected effect of runs; selection of the best ones              (P1) to (P4)
``knowledge``  the surface before the runs, and the errors that runs share      (P5)
``candidates`` settings of the rig as rows of the linear model                  (P1), (P6)
``advice``     target, gain from the runs, stopping, reversal, order of runs    (P3)
============== ================================================================ ================

The equations are on the theory page, section "Planning the next runs".
"""
