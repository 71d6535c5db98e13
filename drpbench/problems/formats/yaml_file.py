"""YAML from anywhere: plain values alone, and no surprises."""

from pathlib import Path
from typing import Any

import yaml

from .problem import FormatError

_LARGEST = 256 << 20  # [bytes]


def read_yaml(path: Path) -> Any:
    """The plain values in a file. Raises FormatError."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        if path.stat().st_size > _LARGEST:
            raise FormatError(f"{path}: larger than {_LARGEST >> 20} MiB")
        # Aliases make no copies, and nobody here walks what they lead to.
        return yaml.load(path.read_bytes(), loader)
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({(error.strerror or '').lower()})") from None
    except yaml.YAMLError as error:
        raise FormatError(f"{path}: not YAML: {' '.join(str(error).split())[:120]}") from None
    except (ValueError, RecursionError) as error:  # a date of no calendar, a thousand brackets
        raise FormatError(f"{path}: not YAML: {type(error).__name__}") from None
