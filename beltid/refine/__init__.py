"""Inverse problem: find the surface for which the simulated rig gives the measured tensions.

============ =========================================================== ==========================
Module       Responsibility                                              Equation
============ =========================================================== ==========================
``curves``   ln mu over ln f_N for every speed, and its roughness        p' Q p
``effects``  effects of arc, run order and temperature on friction       Z u
``evidence`` smoothness and size of effects by marginal likelihood       y = J p + Z u + X e + noise
``rig_runs`` the measured runs on the simulated rig, with derivatives    J = d ln mu / d p
``inverse``  damped Gauss-Newton minimisation of the penalised misfit    r' V^-1 r + p' P p
============ =========================================================== ==========================

The equations are those of the theory page, section "The inverse problem".
"""
