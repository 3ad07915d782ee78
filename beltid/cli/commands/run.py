"""The whole chain for one belt or several."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from beltid.cli.common import Common, with_common_options
from beltid.cli.execute import finish
from beltid.cli.inputs import Jobs
from beltid.cli.program import PlainCommand, app

if TYPE_CHECKING:
    from beltid.cli.talk import TerminalTalk
    from beltid.report.summary import Summary


@app.command("run", cls=PlainCommand, short_help="CONFIG.yaml -> runs/<belt>/: all of the above")
@with_common_options(
    out_help="Folder of the results, one folder per belt in it. Default: runs",
    out_names=("--runs-dir",),
)
def run(
    configs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="CONFIG",
            help="Configs, one per belt. Each names its recordings under data: press and rig are "
            "needed, speedloss may be left out. Default: the config of --config, else the one "
            "that the environment variable BELTID_CONFIG names.",
        ),
    ] = None,
    jobs: Jobs = None,
    *,
    common: Common,
) -> None:
    """Run the whole chain for one belt or several: from the recordings to the comparison.

    Stiffness, sliding speeds, friction, the surface as published and refined; the rig is simulated
    with both surfaces, and both are compared. Results go to runs/<belt>/. What is up to date is
    kept, so that a second run does nothing. A belt that fails does not stop the others.

    Example: beltid run configs/4pk.yaml configs/5pk.yaml
    """
    from beltid.batch import BatchOptions, config_sources, run_batch

    folder = common.out or Path("runs")

    def work(talk: TerminalTalk) -> Summary:
        sources = config_sources(configs or [], common.config)
        return run_batch(sources, folder, BatchOptions(force=common.force, talk=talk, jobs=jobs))

    finish(work, common, kept=f"what was finished stands in {folder}")
