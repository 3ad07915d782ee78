"""Runs of the friction rig: from a recording to a friction coefficient per run.

================ ====================================================== ==================
Module           Responsibility                                         Equation
================ ====================================================== ==================
kinds            what a bench measures, as the tensions of both spans   (6), (7)
plateaus         rows of a table, bins of a falling speed               (6), (8)
reduction        the two passes; a run's mu, forces and status          (6), (8)
prepare          first pass: one run by itself                          (7)
campaign         second pass: variances of a bench, level of each run   (S3)
shared           what all runs share: the tail and common drifts        --
sliding_record   block means of ln(T_tight/T_slack)                     (S1)
tail_shapes      decay of the sticking peak                             (S2)
spectra          which tails a bench can have                           --
noise            covariance of noise with a memory                      --
zeros            zeros and gains of the cells, from the rest            (S4), (S5)
peak             the sticking peak                                      (6)
load_cells       known errors of the cells                              --
channels         gaps, spikes, dead, clipped and swapped cells          --
rest_phase       when the pulley turns, what the rest shows             --
sliding_phase    where the belt slides as a whole                       --
condense         long records in blocks                                 --
rig_table, run   a recording taken apart; what goes in and comes out    --
================ ====================================================== ==================

Equation (6) meets a recording in `reduction._with_plateau`.
"""
