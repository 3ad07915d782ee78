"""Runs of the friction rig: from a recording to a friction coefficient per run.

=========== ============================================================= ==================
Module      Responsibility                                                Equation
=========== ============================================================= ==================
run         settings; a recording taken apart; what comes out             --
kinds       what a bench measures, as the tensions of both spans          (6), (7)
channels    gaps, spikes, dead and clipped cells; rotation and sliding    --
rest        what the cells show at rest, and their errors                 (S4), (S5)
prepare     first pass: one run by itself, its block means                (7), (S1)
shared      what all runs share: the tail and common drifts               (S2)
campaign    second pass: variances of a bench, level of each run          (S3)
reduction   the two passes; mu, forces, sticking peak, status of a run    (6), (8)
plateaus    rows of a table, bins of a falling speed                      (6), (8)
drift_check does the friction of a campaign drift?                        --
=========== ============================================================= ==================

A run goes through `prepare.prepare_run`, then with all others through `campaign.reduce_bench`;
equation (6) meets it in `reduction._with_plateau`.
"""
