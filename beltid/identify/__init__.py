"""Identification: from recordings to contact parameters.

`press`, (1) to (4), `friction`, (5) to (8), and `slip`, (7), evaluate recordings; `surface` gives
mu(f_N, v), section 2.2, `agreement` measured against simulated coefficients, section 4.
"""
