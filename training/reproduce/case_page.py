"""The page of a reproduced case study: figures, tables and remarks in one file without scripts."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from paper_6_tables import Table

from aspnn.cli import say
from aspnn.evaluation.page import versions
from aspnn.records import atomic, write_json

Section = tuple[str, str, str]  # heading, words, figure as SVG


def write_case(
    file: Path, title: str, summary: str, sections: Sequence[Section], tables: Sequence[Table], reasons: str
) -> None:
    """The page, whole or not at all. `reasons` are lines that begin with "- "."""
    from jinja2 import ChoiceLoader, Environment, FileSystemLoader, PackageLoader

    places = [FileSystemLoader(Path(__file__).parent), PackageLoader("aspnn.evaluation", "")]
    environment = Environment(loader=ChoiceLoader(places), autoescape=True, trim_blocks=True, lstrip_blocks=True)
    page = environment.get_template("case_page.html.jinja").render(
        title=title,
        summary=summary,
        sections=list(sections),
        tables=tables,
        reasons=[" ".join(reason.split()) for reason in reasons.split("\n- ")[1:]],
        metadata=versions(),
    )
    file.parent.mkdir(parents=True, exist_ok=True)
    with atomic(file) as temporary:
        temporary.write_text(page)


def print_case(tables: Sequence[Table], words: str) -> None:
    """The tables, then `words`."""
    for table in tables:
        say(False, "\n".join(table.lines()) + "\n")
    say(False, words)


def write_values(file: Path | None, tables: Sequence[Table], **more: Any) -> None:
    """The tables' values by title, and `more`, as JSON into `file`, if there is one: whole or not at all."""
    if file is not None:
        write_json({table.title: table.values for table in tables} | more, file)
