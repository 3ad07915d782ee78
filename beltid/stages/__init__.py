"""One file per command: read, compute, write, sum up. Commands do not import each other.

====================== ========================================================================
Module                 Responsibility
====================== ========================================================================
``setup``              commands before anything is computed: inspect, init, info, config
``results``            commands for people and other programs: report, show, export
``simulation``         the rig simulated, compared, refined, its next runs planned
``drive``              the belt drive simulated and compared
``identification``     from recordings to parameters: press, rig, slip, surface
---------------------- ------------------------------------------------------------------------
``build_artifact``     up to date? replaceable? measured or synthetic? write it
``outcome``            what a stage computed, before it is written
``reporter``           what a stage reports while it works; options of all stages
``workers``            who carries out heavy calls
``tables``             tables and laws from files, or from memory
``uncertainties``      standard uncertainties of a config; budgets for people
====================== ========================================================================
"""
