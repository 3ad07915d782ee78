"""Uncertainty of the results: law of propagation (GUM) and validation (ASME V&V 20)."""
