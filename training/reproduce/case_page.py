"""The page of a reproduced case study: figures, tables and remarks in one file without scripts."""

from collections.abc import Sequence
from pathlib import Path

from paper_6_tables import Table

from aspnn.evaluation.page import versions
from aspnn.records import atomic

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
