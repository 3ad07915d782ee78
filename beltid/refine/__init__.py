"""Inverse problem: find the surface for which the simulated rig gives the measured tensions."""
