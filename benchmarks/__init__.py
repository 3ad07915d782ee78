"""Benchmarks: the simulated rig against Exudyn and against its own targets, one core per claim."""

import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

# before numpy is imported: a claim for one core must not be helped by a threaded library
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = (head, ["---"] * len(head), *rows)
    return "".join(f"|{'|'.join(line)}|\n" for line in lines)


def put(page: Path, chapter: str) -> None:
    """Write a chapter into a page, in place of the one that has its heading."""
    heading = chapter.partition("\n")[0]
    chapters = re.split(r"(?m)^(?=# )", page.read_text("utf-8"))
    of_heading = {text.partition("\n")[0]: text.strip() for text in chapters if text.strip()}
    text = "\n\n".join((of_heading | {heading: chapter.strip()}).values())
    page.write_text(f"{text}\n", "utf-8")
