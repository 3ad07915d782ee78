"""One file per command: read, compute, write, sum up. Commands do not import each other.

========================= ====================================================== ===============
Module                    Responsibility                                         Equation
========================= ====================================================== ===============
``fit_stiffness``         press recording to normal contact law                  (1) to (4)
``fit_slip``              speed loss to sliding speeds in service                (7)
``fit_friction``          rig recording to a coefficient per run                 (5) to (8)
``fit_shear``             build-up of the runs to shear stiffness of the ribs    (B1) to (B4)
``build_surface``         coefficients to mu(f_N, v)                             section 5
``refine_surface``        the surface without the bias of the mean force         beyond section 7
``simulate_rig``          the runs of the rig, simulated                         (9) to (12)
``compare``               measured against simulated                             section 7
``plan``                  the next runs of the rig, or stop                      (P1) to (P6)
``inspect_file``          what is understood of a bench's files
``new_config``            a commented config for a new belt
``report_belt``           the results of a belt, or several, as a page
``show_artifact``         any artifact as a table and a drawing
``export_law``            the contact law for other programs
``about``                 what runs here, what a file is, which values hold
------------------------- ------------------------------------------------------ ---------------
``build_artifact``        up to date? replaceable? measured or synthetic? write it
``outcome``               what a stage computed, before it is written
``reporter``              what a stage reports while it works; options of all stages
``workers``               who carries out heavy calls
``tables``                tables and laws from files, or from memory
``reduction``             settings; the runs of a rig reduced; their table       (5) to (8)
``named_recordings``      are the recordings of a config there, what if one is not
``planned_runs``          which runs are simulated
``campaign``              the runs of a simulated campaign, and their recording
``simulated_runs``        a campaign simulated, its uncertainty, profiles; functions
``refinement``            the runs a surface is refined from; its Monte Carlo draws
``uncertainties``         standard uncertainties of a config; budgets for people
``alternatives``          other normal laws, and friction as a formula
``law_of_belt``           the contact law put together from artifacts
``recorded_curves``       what the figures need of the recordings
``belt_results``          the results in the folder of a belt
``pages``                 report pages: up to date, or replaced
========================= ====================================================== ===============
"""
