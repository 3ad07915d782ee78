"""One module per command: read, compute, write, summarise. Commands do not import each other.

====================== ========================================================================
Module                 Responsibility
====================== ========================================================================
``setup``              commands that compute nothing: inspect, init, config
``results``            output for people and other programs: report, show, export
``simulation``         simulate the rig, compare, refine the surface, plan the next runs
``drive``              simulate the belt drive and compare it with measurements
``identification``     from recordings to parameters: press, rig, slip, surface
---------------------- ------------------------------------------------------------------------
``build_artifact``     check whether an artifact is up to date or replaceable; write it
``outcome``            result of a stage, before it is written
``reporter``           progress messages of a stage; options of all stages
``workers``            where heavy calls run
``tables``             tables and laws from files or from memory
``uncertainties``      standard uncertainties of a config; budgets for display
====================== ========================================================================
"""
