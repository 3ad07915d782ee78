"""Uncertainty of the results: law of propagation (GUM) and validation (ASME V&V 20).

`sources` lists the kinds of errors and budgets, `measured` corrects runs of the rig and the contact
law for them, `rig_runs` runs on the simulated rig, with derivatives by friction and inputs,
`simulated` their difference from measured runs, `drive` the speed losses of a drive. The refined
surface (:mod:`beltid.refine`) and the plan (:mod:`beltid.plan`) propagate with the same sources.
"""
