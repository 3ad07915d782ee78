"""Show the values of a config in effect, and check configs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from beltid.cli.execute import finish, print_text
from beltid.cli.program import Common, app, command

if TYPE_CHECKING:
    from beltid.stages.reporter import Options


config_app = typer.Typer(
    name="config",
    help="Show the values that a config states or that are in effect, or check configs.",
    short_help="show or check a config",
    rich_markup_mode=None,
    no_args_is_help=True,
    context_settings={"help_option_names": ["--help", "-h"]},
)
app.add_typer(config_app)


@command("show", of=config_app, short="the values that are stated, or all in effect")
def show(
    file: Annotated[
        Path | None,
        typer.Argument(
            metavar="FILE", help="Input whose config is searched for, as in every command."
        ),
    ] = None,
    complete: Annotated[
        bool, typer.Option("--all", help="Show all values in effect, defaults too.")
    ] = False,
    *,
    common: Common,
) -> None:
    """Print the values that the config states, as YAML with the range of every key.

    The config is that of --config, else the one that a command would find for FILE, else the
    built-in 5PK rig. With --all, the defaults of all other keys too.

    Example: beltid config show rig.csv --all
    """
    from beltid.config import config_text, find_config
    from beltid.stages.setup.about import config_values

    if common.json:
        finish(lambda _: config_values(find_config(file, common.config), complete=complete), common)

    def text(options: Options) -> str:
        source = find_config(file, common.config)
        options.reporter.report(f"config: {source.origin}")
        return config_text(source.config, complete=complete)

    print_text(text, common)


@command("check", of=config_app, short="all problems in configs")
def check(
    configs: Annotated[list[Path], typer.Argument(metavar="CONFIG", help="Configs to check.")],
    *,
    common: Common,
) -> None:
    """Check configs as run does: keys, values, recordings that are missing or empty.

    Reports all problems at once, with file, line and column. Exit status 2 if there are any.
    A recording that cannot be read as the config states is a warning.

    Example: beltid config check configs/5pk.yaml
    """
    from beltid.stages.setup import about as stage

    finish(lambda options: stage.check_configs(configs), common)
