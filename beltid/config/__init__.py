"""Configs: YAML -> frozen model, with errors that carry file, line and column.

`model` states the keys, by `checks`; `loading` reads YAML with its places, finds and loads a
config, words its errors, and writes it.
"""

from beltid.config.loading import ConfigSource, config_text, find_config, load_config
from beltid.config.model import Config

__all__ = ["Config", "ConfigSource", "config_text", "find_config", "load_config"]
