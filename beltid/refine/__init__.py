"""The inverse problem: the surface with which the simulated rig gives the measured tensions.

============ =========================================================== ==========================
Module       Responsibility                                              Equation
============ =========================================================== ==========================
``curves``   ln mu over ln f_N for every speed, and its roughness        p' Q p
``effects``  what shifts the friction beside the surface                 Z u
``evidence`` how smooth, how large: marginal likelihood                  y = J p + Z u + X e + noise
``rig_runs`` the measured runs on the simulated rig, with slopes         J = d ln mu / d p
``inverse``  damped Gauss-Newton down the penalised misfit               r' V^-1 r + p' P p
============ =========================================================== ==========================

The equations are those of the page on theory, section "The inverse problem".
"""
