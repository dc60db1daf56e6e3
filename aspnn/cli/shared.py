"""The `aspnn` command itself, the options that commands share, and how all of them print, watch and fail."""

import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any

import typer

from aspnn.schema import InputError

app = typer.Typer(
    help="aspnn, the open advanced ship predictor: where the hull will be 10 to 90 s after a rudder order.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # the boxes would double the time of --help
)

Out = Annotated[Path, typer.Option("--out", help="Folder that receives the files.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]
Logs = Annotated[list[Path], typer.Argument(help="Canonical logs: files or folders.", show_default=False)]
NoiseFile = Annotated[
    Path | None, typer.Option("--noise", help="Noise file (of `aspnn tune`) in place of the vessel's noise and delays.")
]
Checkpoint = Annotated[Path, typer.Argument(help="Checkpoint folder.", show_default=False)]


def watch(things: Iterable, what: str, count: int) -> Iterable:
    """A progress bar on standard error around `things`, silent when that is no terminal."""
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    return track(things, what, total=count, console=console, disable=not console.is_terminal, transient=True)


def say(quiet: bool, text: Any) -> None:
    """Print a line (or a table) unless quiet."""
    if not quiet:
        from rich.console import Console

        # A pipe has no width: tables must not be cut there. Units in brackets are no markup; a table's is its maker's.
        line, width = isinstance(text, str), None if sys.stdout.isatty() else 140
        Console(width=width, highlight=False, markup=not line, soft_wrap=line).print(text)


def guarded(run: Callable[[], Any]) -> None:
    """Run a command or a script. What a user got wrong is one line on standard error and exit code 2."""
    try:
        run()
    except InputError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(2)
    except OSError as error:
        sys.stderr.write(f"error: {error.filename or 'file'}: {error.strerror or error}\n")
        sys.exit(2)
    except KeyboardInterrupt:
        sys.stderr.write("stopped\n")
        sys.exit(130)
