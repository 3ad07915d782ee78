"""Identification: from recordings to contact parameters, a module or package per question.

========== ============================================================ ==================
Module     Responsibility                                               Equation
========== ============================================================ ==================
press      recording of the press to the normal contact law             (1) to (4)
friction   runs of the rig to friction coefficients                     (5), (6), (8)
slip       speed loss to sliding speed                                  (7)
surface    friction coefficients to the surface mu(f_N, v)              section 2.2
agreement  measured against simulated coefficients                      section 4
estimators noise, spikes, correlation and least squares, for all        --
========== ============================================================ ==================
"""
