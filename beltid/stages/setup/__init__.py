"""Commands that compute nothing: inspect files, write a config, show version and settings.

==================== ===========================================================================
Module               Responsibility
==================== ===========================================================================
``inspect_file``     show how the files of a bench are read
``new_config``       write a commented config for a new belt
``named_recordings`` check the recordings that a config names before a run
``about``            show version, file metadata and effective settings
==================== ===========================================================================
"""
