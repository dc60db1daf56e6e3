"""Write the column tables of aspnn/schema.py into data/README.md, between its markers: `python data/columns.py`."""

from pathlib import Path

from aspnn.schema import markdown

README = Path(__file__).parent / "README.md"
OPEN, CLOSE = "<!-- columns -->\n", "<!-- /columns -->\n"


def renewed(text: str) -> str:
    """`text` with the tables between its markers replaced by those of the schema."""
    before, rest = text.split(OPEN)
    _, after = rest.split(CLOSE)
    return f"{before}{OPEN}{markdown()}{CLOSE}{after}"


if __name__ == "__main__":
    README.write_text(renewed(README.read_text()))
