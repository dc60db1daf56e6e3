"""The `aspnn` command: parse, call, print. No numerics here, and nothing heavy is imported before a command runs."""

from aspnn.cli import live, logs, models, ships  # noqa: F401 - they hold the commands
from aspnn.cli.shared import app, guarded, say, watch

__all__ = ["app", "guarded", "main", "say", "watch"]


def main() -> None:
    """The `aspnn` command."""
    guarded(app)
