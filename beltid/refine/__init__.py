"""Inverse problem: find the surface for which the simulated rig gives the measured tensions.

============= =========================================================== =========================
Module        Responsibility                                              Equation
============= =========================================================== =========================
``curves``    ln mu over ln f_N for every speed, in smooth coordinates    p = B h
``posterior`` the runs as a mixed model: effects of arc, order and        y = X h + Z u + S e + e_0
              temperature; sizes, estimate, covariance
``inverse``   damped Gauss-Newton iteration on the simulated rig          J = d ln mu / d p
``shown``     what the runs show besides the surface
============= =========================================================== =========================

The equations are those of the theory page, section "The inverse problem".
"""
