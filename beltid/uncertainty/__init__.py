"""Uncertainty of the results: law of propagation (GUM) and validation (ASME V&V 20).

`sources` lists the kinds of errors and budgets, `measured` corrects runs of the rig and the contact
law for them, `simulated` propagates them through the simulated rig, `drive` to speed losses.
"""
