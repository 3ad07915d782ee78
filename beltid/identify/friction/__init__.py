"""Runs of the friction rig: from a recording to a friction coefficient per run, Eqs. (5) to (8)."""
