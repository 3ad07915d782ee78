"""Configs: YAML -> frozen model, with errors that carry file, line and column.

================ =========================================================
Module           Responsibility
================ =========================================================
``model``        what a config holds, with its defaults (the 5PK rig of the paper)
``drive``        the sections of a belt drive
``fields``       sections and kinds of values: numbers with bounds and units, names, lists
``yaml_source``  YAML text -> plain values with their places
``messages``     words of the errors
``name_pattern`` settings in the names of files, by a pattern or a regular expression
``sweep``        a section of lists of values -> cases
``loading``      file or dict -> `Config`; which belongs to a recording; where values are stated
``writing``      `Config` -> YAML text
``template``     `Config` -> YAML text for a new belt, with the meanings of its keys
================ =========================================================
"""

from beltid.config.loading import ConfigSource, find_config, load_cases, load_config
from beltid.config.model import Config
from beltid.config.writing import config_text

__all__ = ["Config", "ConfigSource", "config_text", "find_config", "load_cases", "load_config"]
