"""Choose the next runs of the friction rig, and decide when to stop.

============== ================================================================ ================
Module         Responsibility                                                   Equation
============== ================================================================ ================
``design``     expected effect of runs; selection of the best ones              (P1) to (P4)
``knowledge``  the surface before the runs, and the errors that runs share      (P5)
``candidates`` settings of the rig as rows of the linear model                  (P1), (P6)
``target``     where the surface must be known, and its regions                 (P3)
``advice``     gain from the runs, remaining uncertainty, stopping, reversal    (P3)
``session``    order and start times of the runs
============== ================================================================ ================

The equations are on the theory page, section "Planning the next runs".
"""
