"""The rig on the computer: the parameters proven, refined, and the next runs planned.

==================== =========================================================== ===============
Module               Responsibility                                              Equation
==================== =========================================================== ===============
``simulate_rig``     the runs of the rig, simulated                              (9) to (12)
``compare``          measured against simulated                                  section 7
``refine_surface``   the surface without the bias of the mean force              beyond section 7
``plan``             the next runs of the rig, or stop                           (P1) to (P6)
``plan_inputs``      what a plan starts from: settings, the known surface, noise
``plan_tables``      what a plan writes and shows
``planned_runs``     which runs are simulated
``campaign``         a simulated campaign: its runs, their results and recording
``simulated_runs``   one run, or a campaign, simulated from Python
``refinement``       the runs a surface is refined from; its Monte Carlo draws
``hold_out``         the runs of an arc, or speed, predicted from the others
==================== =========================================================== ===============
"""
