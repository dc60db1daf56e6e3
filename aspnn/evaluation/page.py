"""What the HTML pages share: one file with everything in it, interactive and readable without a network."""

import platform
import re
from importlib import metadata as packages
from typing import TYPE_CHECKING, Any

from aspnn import __version__

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def fill(template: str, **content: Any) -> str:
    """The page of a template of this package (its name), with plotly's script as `plotly` beside the `content`."""
    from jinja2 import Environment, PackageLoader

    loader = PackageLoader("aspnn.evaluation", "")
    environment = Environment(loader=loader, autoescape=True, trim_blocks=True, lstrip_blocks=True)
    return environment.get_template(template).render(plotly=_bundle(), **content)


def embed(figure: "Figure", name: str) -> str:
    """A figure as the HTML of its own element; the plotly bundle stands once in the page."""
    from plotly.io import to_html

    config = {"displaylogo": False, "responsive": True, "modeBarButtonsToRemove": ["lasso2d", "select2d"]}
    return to_html(figure, full_html=False, include_plotlyjs=False, config=config, div_id=name)


def versions() -> dict[str, Any]:
    """The versions that made a page, by package."""
    names = ("torch", "numpy", "scipy", "numba", "plotly")
    return {"aspnn": __version__, "python": platform.python_version()} | {n: packages.version(n) for n in names}


def _bundle() -> str:
    """plotly's script. Its links to makers of web maps, which no page shows, are taken out: no address is left."""
    from plotly.offline import get_plotlyjs

    return re.sub(r"""(href=\\?["'])https?://[^"'\\]*""", r"\1#", get_plotlyjs())
