"""The steps of the method and the other commands: read, compute, write, summarise.

====================== ======================================================= ==============
Module                 Responsibility                                          Equation
====================== ======================================================= ==============
``steps``              the steps: what each reads, uses and makes
``stiffness``          press recording to normal contact law                   (1) to (4)
``slip``               speed loss to sliding speeds in service                 (7)
``friction``           rig recording, measured or simulated, to mu per run     (5) to (8)
``plausible``          channels of a rig that contradict each other
``surface``            coefficients to mu(f_N, v), as published                section 2.2
``planned_runs``       which runs are simulated
``rig``                the runs of the rig, simulated; one run from Python     (9) to (12)
``refine``             the surface that gives the measured tensions            beyond
``compare``            measured against simulated                              section 4
``cross_validate``     runs left out, predicted from the others                beyond
``drive_of_config``    the drive of a config and its operating points
``drive``              a belt drive from the identified laws                   section 2.2
``compare_drive``      predicted against measured losses
``plan``               the next runs of the rig
``curves``             parts of the recordings that the report shows
---------------------- ------------------------------------------------------- --------------
``inspect_file``       how a file is read; a config for a new belt
``about``              versions, values of a config, recordings that it names
``show``               any artifact as a table or a figure
``report_belt``        the page of a belt; ``page_mark``: whether it is in date
``export_law``         the law for other programs
---------------------- ------------------------------------------------------- --------------
``inputs``             laws, surfaces, runs, uncertainties from files or memory
``columns``            columns and rows of tables
``workers``            where heavy calls run
====================== ======================================================= ==============
"""
