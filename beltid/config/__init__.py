"""Configs: YAML -> frozen model, with errors that carry file, line and column.

================ =========================================================
Module           Responsibility
================ =========================================================
``model``        the sections and keys with their defaults (the 5PK rig of the paper)
``checks``       checks of values: numbers with bounds and units, names, lists
``fields``       keys: default, check and meaning, stated once
``layout``       what a config says about the files of a bench, by column
``source``       YAML text with line and column of every key and value
``messages``     texts of the errors
``name_pattern`` settings in file names, by a pattern or a regular expression
``loading``      file or dict -> `Config`; config of a recording; its values
``writing``      `Config` -> YAML text, also commented for a new belt
================ =========================================================
"""

from beltid.config.loading import ConfigSource, find_config, load_config
from beltid.config.model import Config
from beltid.config.writing import config_text

__all__ = ["Config", "ConfigSource", "config_text", "find_config", "load_config"]
