"""Inverse problem: find the surface for which the simulated rig gives the measured tensions.

============= =========================================================== =========================
Module        Responsibility                                              Equation
============= =========================================================== =========================
``curves``    ln mu over ln f_N for every speed, in smooth coordinates    p = B h
``effects``   effects of arc, run order and temperature on friction       Z u
``posterior`` the runs as a mixed model: sizes, estimate, covariance      y = X h + Z u + S e + e_0
``inverse``   damped Gauss-Newton iteration on the simulated rig          J = d ln mu / d p
``shown``     what the runs show besides the surface
============= =========================================================== =========================

The equations are those of the theory page, section "The inverse problem".
"""
