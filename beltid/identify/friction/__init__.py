"""Reduce recordings of the friction rig to one friction coefficient per run.

=========== ============================================================= ==================
Module      Responsibility                                                Equation
=========== ============================================================= ==================
run         settings; split a recording into runs; result of a run        (6), (8)
kinds       tensions of both spans from the channels of each rig kind     (6), (7)
channels    gaps, spikes, dead and clipped cells; rest, rotation, sliding --
prepare     first pass: each run alone, its block means                   (7), (S1)
bench_model second pass: all runs in one mixed model, level of each run   (S2)
cells       zeros and gains of the cells                                  (S3), (S4)
reduction   both passes; plateau, sticking peak and status of a run       --
plateaus    rows of a table                                               (6)
=========== ============================================================= ==================

`prepare.prepare_run` processes each run alone, `bench_model.fit_bench` then all runs together;
`run.RunReduction.set_plateau` applies equations (6) and (8).
"""
