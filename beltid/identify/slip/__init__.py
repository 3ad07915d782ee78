"""Sliding speeds of a belt in service, from speed-loss recordings, Eq. (7).

``slip`` finds the sliding speed of every operating point, ``points`` gross slip and the pulley
speeds that the friction rig must cover.
"""
