"""Inverse problem: find the surface for which the simulated rig gives the measured tensions.

`posterior` holds the linear model of the runs, `inverse` the damped Gauss-Newton iteration on the
simulated rig. The equations are those of the theory page, section "The inverse problem".
"""
