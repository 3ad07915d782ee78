"""The simulated rig: validate the parameters, refine the surface, plan the next runs.

==================== =========================================================== ===============
Module               Responsibility                                              Equation
==================== =========================================================== ===============
``simulate_rig``     simulate the runs of the rig                                (9) to (12)
``compare``          compare measured with simulated friction                    section 4
``refine_surface``   remove the bias of the mean force from the surface          beyond section 4
``plan``             plan the next runs of the rig, or stop                      (P1) to (P6)
``plan_inputs``      inputs of a plan: settings, the known surface, noise
``plan_tables``      output tables of a plan
``planned_runs``     select the runs to simulate
``campaign``         a simulated campaign: runs, results and recording
``simulated_runs``   simulate one run or a campaign from Python
``refinement``       runs that a surface is refined from
``hold_out``         predict the runs of an arc or speed from the others
==================== =========================================================== ===============
"""
