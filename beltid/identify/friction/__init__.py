"""Reduce recordings of the friction rig to one friction coefficient per run.

=========== ============================================================= ==================
Module      Responsibility                                                Equation
=========== ============================================================= ==================
run         settings; split a recording into runs; result of a run        (6), (8)
kinds       tensions of both spans from the channels of each rig kind     (6), (7)
channels    gaps, spikes, dead and clipped cells; rotation and sliding    --
rest        readings of the cells at rest, and errors of the cells        (S4), (S5)
prepare     first pass: each run alone, its block means                   (7), (S1)
shared      effects common to all runs: the tail and common drifts        (S2)
campaign    second pass: variances of a bench, level of each run          (S3)
reduction   both passes; plateau, sticking peak and status of a run       --
plateaus    rows of a table, bins of a changing speed                     (6)
=========== ============================================================= ==================

`prepare.prepare_run` processes each run alone, `campaign.reduce_bench` then all runs together;
`run.RunReduction.set_plateau` applies equations (6) and (8).
"""
