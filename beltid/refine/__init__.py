"""The inverse problem: the surface with which the simulated rig gives the measured tensions."""
