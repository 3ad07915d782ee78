"""Before anything is computed: what files hold, a config for a new belt, what runs here.

==================== ===========================================================================
Module               Responsibility
==================== ===========================================================================
``inspect_file``     what is understood of a bench's files
``new_config``       a commented config for a new belt
``named_recordings`` the recordings that a config names, judged before a run
``about``            what runs here, what a file is, which values hold
==================== ===========================================================================
"""
