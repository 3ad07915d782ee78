"""Configs: YAML -> frozen model, with errors that carry file, line and column.

`model` states the keys, by `fields` and `checks`; `layout` those about files of a bench. `source`
reads YAML with its places, `messages` words the errors, `loading` loads, `writing` writes.
"""

from beltid.config.loading import ConfigSource, find_config, load_config
from beltid.config.model import Config
from beltid.config.writing import config_text

__all__ = ["Config", "ConfigSource", "config_text", "find_config", "load_config"]
