"""Settings files: TOML held to a pydantic model, with one clear line when something is wrong in it."""

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from aspnn.schema import InputError

Model = TypeVar("Model", bound=BaseModel)


def read_toml(path: str | Path, model: type[Model], **defaults: Any) -> Model:
    """The settings in a TOML file as `model`; `defaults` fill keys that the file leaves out.

    Raises InputError, one line that names the file, the key and what is wrong with it.
    """
    path = Path(path)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: cannot be read as TOML ({str(error).splitlines()[0]})") from None
    try:
        return model.model_validate({**defaults, **data})
    except ValidationError as error:
        raise InputError(f"{path}: {_first(error, data)}") from None


def _first(error: ValidationError, data: dict[str, Any]) -> str:
    """The first problem of a validation: the key as the file writes it, and why."""
    problem = error.errors()[0]
    # pydantic puts the chosen member of a union among the keys; the file does not have it.
    keys, place = [], data
    for part in problem["loc"]:
        inside = (isinstance(place, dict) and part in place) or (isinstance(place, list) and part in range(len(place)))
        if inside:
            place = place[part]  # type: ignore[index]
            keys.append(str(part))
        elif part == problem["loc"][-1]:
            keys.append(str(part))
    reason = problem["msg"].removeprefix("Value error, ")
    if problem["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        reason = "is not a known key"
    elif problem["type"] == "missing":
        reason = "is missing"
    return f"{'.'.join(keys)}: {reason[:1].lower()}{reason[1:]}"
