"""Configs: YAML -> frozen model, with errors that carry file, line and column.

`model` states the keys, by `checks`; `source` reads YAML with its places; `loading`
finds and loads a config and words its errors; `writing` writes it.
"""

from beltid.config.loading import ConfigSource, find_config, load_config
from beltid.config.model import Config
from beltid.config.writing import config_text

__all__ = ["Config", "ConfigSource", "config_text", "find_config", "load_config"]
