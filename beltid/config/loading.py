"""A config as YAML and back: read with its places, checked, found for a recording, written."""

from __future__ import annotations

import codecs
import difflib
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from beltid.config.checks import Section, allowed, section_in
from beltid.config.model import Config
from beltid.errors import ConfigError

UNKNOWN = ("extra_forbidden", "invalid_key", "unknown")  # key; of other errors, the value
LAYOUT = ("columns", "units", "runs")
MAX_BYTES = 100_000
KeyPath = tuple[str | int, ...]
Place = tuple[int, int]  # line and column, from 1; 0 if unknown
HEAD = """\
# Config of the belt {name}, for beltid.
#
# Units are part of a key. A line such as "# ribs: 5" shows a default: remove the # and enter your
# own value. `beltid config check FILE` checks this file, `beltid config show --all -c FILE` shows
# all keys with their values, including the sections friction, simulation, drive and plan, and
# columns, units and dialect for files in another format.
"""
SECTIONS = (
    *("belt", "press", "rig", "conditions", "contact", "data"),
    *("compare", "compare_drive", "uncertainty"),
)
"""Sections of a new config, in its order."""


def load_config(source: str | Path | Mapping[str, Any] | Config | None = None) -> Config:
    """Load a config; missing values are those of the built-in 5PK rig.

    Parameters
    ----------
    source : path, mapping, Config or None
        A YAML file, a dict of the same shape, or None for the built-in 5PK rig of the paper.
        Relative paths under `data` start at the folder of the file.

    Returns
    -------
    Config
        The frozen config.

    Raises
    ------
    ConfigError
        With one line per problem: file, line, column, key path, found, allowed.
    """
    if source is None:
        return Config()
    if isinstance(source, Config):
        return source
    if isinstance(source, Mapping):
        return _checked(Source(source))
    if not isinstance(source, (str, Path)):
        raise ConfigError(
            f"config = {type(source).__name__}, must be the path of a YAML file or a dict"
        )
    config, folder = _checked(read_source(Path(source))), Path(source).parent
    data = config.data.model_copy(
        update={kind: _shorten(folder / path) for kind, path in config.data.files.items()}
    )
    runs = {
        kind: {**config.runs[kind], "table": _shorten(folder / table)}
        for kind, table in config.run_tables.items()
    }
    return config.model_copy(update={"data": data, "runs": config.runs | runs})


def _checked(source: Source) -> Config:
    """Validate the values of a source; raise all problems, in the order of the file."""
    # an empty section, such as `compare:` with all keys commented out, means its defaults
    try:
        return Config.model_validate(
            {
                key: value
                for key, value in source.values.items()
                if value is not None or key not in Config.model_fields
            }
        )
    except ValidationError as error:
        problems = [
            (
                source.place(detail["loc"], key=detail["type"] in UNKNOWN),
                message(detail, Config, source.node(detail["loc"])),
            )
            for detail in error.errors(include_url=False)
        ]
    raise ConfigError(
        [f"{source.at(p)}{text}" for p, text in sorted(problems, key=lambda found: found[0])]
    )


def _shorten(path: Path) -> Path:
    """Shorten ``configs/../rigdata`` to ``rigdata``, unless a symbolic link makes them differ."""
    short = os.path.normpath(path)
    return Path(short) if os.path.realpath(short) == os.path.realpath(path) else path


@dataclass(frozen=True, slots=True)
class ConfigSource:
    """A config, its origin for the user and the results, and its file (None: built in)."""

    config: Config
    origin: str
    path: Path | None = None

    @property
    def name(self) -> str:
        """Name of the belt, and of the folder of its results."""
        return self.config.belt.name


def find_config(
    recording_path: str | Path | None = None, explicit: str | Path | None = None
) -> ConfigSource:
    """Find the config of a recording or artifact.

    The first of: `explicit`; the file named by ``$BELTID_CONFIG``; ``<stem>.yaml``, then
    ``beltid.yaml``, next to the recording, then in each parent folder; the built-in 5PK rig.
    """
    if explicit is not None:
        return ConfigSource(load_config(explicit), f"{explicit} (--config)", Path(explicit))
    if named := os.environ.get("BELTID_CONFIG", "").strip():
        return ConfigSource(load_config(named), f"{named} (named by $BELTID_CONFIG)", Path(named))
    if recording_path is not None:
        recording = Path(os.path.abspath(recording_path))
        stem = Path(recording.name.removesuffix(".gz")).stem
        for path in (
            f / name for f in recording.parents for name in (f"{stem}.yaml", "beltid.yaml")
        ):
            if os.path.isfile(path):  # False, too, in a folder that may not be read
                return ConfigSource(load_config(path), f"{path} (found for {recording.name})", path)
    return ConfigSource(Config(), "the built-in 5PK rig of the paper")


def effective_values(
    values: Section | Mapping[str, Any], above: KeyPath = ()
) -> Iterator[tuple[KeyPath, Any, bool]]:
    """Yield the path of every key of a config, its value, and whether it is stated, in order."""
    stated = values.model_fields_set if isinstance(values, Section) else values
    for name, value in dict(values).items():
        path = (*above, name)
        if isinstance(value, Section) or (path[0] in LAYOUT and isinstance(value, Mapping)):
            yield from effective_values(value, path)
        elif value is not None or path[0] not in LAYOUT:
            yield path, value, name in stated


def message(detail: Mapping[str, Any], model: type[Section], node: Any = None) -> str:
    """Describe an error of the model: key path, what was found (as in a node), what is allowed."""
    path, kind = tuple(detail["loc"]), detail["type"]
    if kind in UNKNOWN:
        known = detail.get("ctx", {}).get("known") or _keys_at(path[:-1], model)
        return f"{format_path(path)} is not a known key{_remedy(path, known, model)}"
    if kind in ("model_type", "model_attributes_type"):
        keys = ", ".join(_keys_at(path, model))
        detail = {**detail, "msg": f"must be a section with the keys {keys}"}
    return problem(detail, path, _found(detail["input"], node))


def problem(detail: Mapping[str, Any], place: KeyPath, found: str = "") -> str:
    """Describe a pydantic error: place, found, and what is allowed, ``must be last or first``."""
    if detail["type"] == "missing":
        return f"{format_path(place)} is missing"
    allowed = str(detail["msg"]).replace("Input should be", "must be")
    if detail["type"] == "literal_error":
        allowed = "must be " + str(detail["ctx"]["expected"]).replace("'", "")
    return f"{format_path(place)} = {found or repr(detail['input'])[:60]}, {allowed}"


def _remedy(path: KeyPath, known: Sequence[str], model: type[Section]) -> str:
    """Name the nearest known key, or that of another section, or all known keys."""
    word = str(path[-1])
    others = [f"{name}.{word}" for name in model.model_fields if word in _keys_at((name,), model)]
    if near := [*difflib.get_close_matches(word, known, n=1), *others]:
        return f", did you mean {near[0]}?"
    return f", known are {', '.join(known)}"


def _keys_at(path: KeyPath, model: type[Section]) -> tuple[str, ...]:
    here: type[Section] | None = model
    for part in path:
        if isinstance(part, str) and here is not None:
            here = section_in(here.model_fields[part].annotation)
    return tuple(here.model_fields) if here else ()


def _found(value: Any, node: Any) -> str:
    """Return a value as the user wrote it, shortened."""
    if isinstance(value, (Mapping, list, tuple)):
        return "a section" if isinstance(value, Mapping) else "a list"
    if value is None:
        return "empty"
    written = f'"{value}"' if isinstance(value, str) else str(node.value if node else value)
    text = "".join(c if c.isprintable() else "?" for c in written)
    return text if len(text) <= 60 else text[:57] + "..."


def format_path(path: KeyPath) -> str:
    """Format a key path as a person writes it: ``rig.arcs_deg[1]``."""
    return "".join(
        f"[{part}]" if isinstance(part, int) else f".{part}" for part in path
    ).removeprefix(".")


@dataclass(frozen=True)
class Source:
    """Values of a config, the name of its file, and its YAML, whose nodes know their places."""

    values: Any
    name: str = ""
    root: Any = None

    def node(self, path: KeyPath, *, key: bool = False) -> Any:
        """Return the YAML node of a value (or key); if it is absent, that of its section."""
        node = self.root
        for depth, part in enumerate(path, 1):
            if not (found := [of for name, *of in _items(node) if str(name) == str(part)]):
                break
            node = found[0][not (key and depth == len(path))]
        return node

    def place(self, path: KeyPath, *, key: bool = False) -> Place:
        """Return the place of a value (or key); if it is absent, that of its section."""
        node = self.node(path, key=key)
        return _place(node.start_mark) if node else (0, 0)

    def at(self, place: Place) -> str:
        """Return ``file:line:column: ``, as far as known."""
        where = f":{place[0]}:{place[1]}" if place[0] else ""
        return f"{self.name}{where}: " if self.name else ""


def read_source(path: Path) -> Source:
    """Read a YAML file; what is no YAML, or holds no sections, is a ConfigError with its place."""
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1).removeprefix(codecs.BOM_UTF8)
        text = raw.decode()
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise ConfigError(
            f"{path}:{line}: byte 0x{raw[error.start]:02X} is not UTF-8, save the config as UTF-8"
        ) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ConfigError(f"{path}: the config cannot be read: {reason}") from None
    if len(raw) > MAX_BYTES:
        raise ConfigError(f"{path}: larger than {MAX_BYTES:,} bytes, this is not a config")
    source = _parsed(text, str(path))
    if not isinstance(source.values, Mapping):
        found = _found(source.values, None)
        raise ConfigError(f"{path}:1:1: is {found}, must hold sections such as belt:, rig:")
    return source


def _parsed(text: str, name: str) -> Source:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError

    yaml, root, place = YAML(typ="safe", pure=True), None, name
    try:
        root = yaml.compose(text)
        return Source(root and yaml.constructor.construct_document(root), name, root)
    except MarkedYAMLError as error:
        if mark := error.problem_mark or error.context_mark:
            place = "{}:{}:{}".format(name, *_place(mark))
        found = str(error.problem).partition(" with value")[0]  # of a duplicate key
        plainly = {
            "'\\t'": "a tab, indent with blanks",
            "mapping values are not": "an unexpected ':' (is the line above indented alike, is a "
            "text in quotes?)",
        }
        reason = next((text for words, text in plainly.items() if words in found), found)
    except Exception as error:  # malformed characters, escapes and numbers raise almost any error
        reason = str(error).partition("\n")[0][:200]
    raise ConfigError(f"{place}: not valid YAML: {reason}")


def _items(node: Any) -> list[tuple[str | int, Any, Any]]:
    """Return name, node of the key and of the value of each item of a section or list."""
    if node is None or node.id == "scalar":
        return []
    if node.id == "sequence":
        return [(i, item, item) for i, item in enumerate(node.value)]
    return [(str(key.value), key, value) for key, value in node.value]


def _place(mark: Any) -> Place:
    return mark.line + 1, mark.column + 1


def config_text(config: Config, *, complete: bool = True) -> str:
    """Write a config, or only what it states, as YAML that `load_config` reads as equal."""
    shown = {path: "" for path, _, stated in effective_values(config) if complete or stated}
    return _text(config, shown) if shown else "{}  # nothing is stated\n"


def template_text(config: Config, sources: Mapping[str, str]) -> str:
    """Write a config for a new belt: what is stated, with its source; the rest commented out.

    What is commented out stays a default: an uncertainty that is not stated is an assumption.
    """
    values = [item for item in effective_values(config) if item[0][0] in SECTIONS]
    shown = {path: sources.get(format_path(path)) for path, _, _ in values}
    files = {kind: str(path) for kind, path in config.data.files.items()}  # as the user names them
    config = config.model_copy(update={"data": config.data.model_copy(update=files)})
    return f"{HEAD.format(name=config.belt.name)}\n{_text(config, shown)}"


def _text(config: Config, shown: Mapping[KeyPath, str | None]) -> str:
    """Write some keys, each with a note; keys without one are commented out."""
    sections = [_lines({name: value}, shown, ()) for name, value in config]
    return "\n\n".join("\n".join(lines) for section in sections if (lines := list(section))) + "\n"


def _lines(
    values: Section | Mapping[str, Any], shown: Mapping[KeyPath, str | None], above: KeyPath
) -> Iterator[str]:
    indent = "  " * len(above)
    for name, value in dict(values).items():
        path = (*above, name)
        if path in shown:
            of, notes = type(values), [shown[path]]
            if issubclass(of, Section):
                notes = [of.model_fields[name].description, allowed(of, name), *notes]
            line = f"{indent}{'# ' if shown[path] is None else ''}{name}: {value_text(value)}"
            yield _line(line, "; ".join(filter(None, notes)))
        elif isinstance(value, (Section, dict)):
            inside = list(_lines(value, shown, path))
            title = str(value.__doc__).splitlines()[0] if isinstance(value, Section) else ""
            yield from [_line(f"{indent}{name}:", title), *inside] if inside else ()


def _line(text: str, comment: str) -> str:
    return f"{text:<43} # {comment}" if comment else text


def value_text(value: Any) -> str:
    """Format a value as YAML text."""
    if isinstance(value, (Section, dict)):
        items = (f"{value_text(name)}: {value_text(item)}" for name, item in dict(value).items())
        return "{" + ", ".join(items) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(value_text, value)) + "]"
    if isinstance(value, Path):
        value = os.path.abspath(value)  # the text may be saved in any folder
    if isinstance(value, str) and re.fullmatch(r"[A-Za-z/][\w./-]*", value, re.ASCII):
        return value if value.lower() not in ("null", "true", "false") else f'"{value}"'
    text = json.dumps(value, ensure_ascii=False)
    # 1e-05 is a number only in YAML 1.2; with a point it is one for every reader
    return text.replace("e", ".0e") if isinstance(value, float) and "." not in text else text
