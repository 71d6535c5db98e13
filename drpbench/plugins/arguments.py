"""Keyword parameters from the command line (`--policy-arg speed=0.3`), read by a policy's own
signature."""

import inspect
import math
import typing
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

from .errors import PolicyError

_READABLE = (bool, int, float, str)  # in the order in which a union of several is tried
_TRUE, _FALSE = ("true", "yes", "on", "1"), ("false", "no", "off", "0")


def read(
    name: str, make: Callable[..., Any], given: Sequence[str], fixed: Collection[str] = ()
) -> dict[str, Any]:
    """The keyword arguments that `given` ("speed=0.3", ...) means for `make`.

    Values are read by each parameter's annotation, or the type of its default where there is none:
    int, float, bool or str. Those in `fixed` are settled already. Raises PolicyError, naming the
    policy as `name`.
    """
    offered = {key: value for key, value in _offered(make).items() if key not in fixed}
    found: dict[str, Any] = {}
    for text in given:
        key, equals, value = text.partition("=")
        if not equals or not key:
            raise PolicyError(f"--policy-arg: expected NAME=VALUE, got {text!r}")
        if key not in offered:
            known = ", ".join(offered) or "none"
            raise PolicyError(f"--policy-arg {key}: {name} has no such parameter; it has: {known}")
        if key in found:
            raise PolicyError(f"--policy-arg {key}: given twice")
        found[key] = _value(name, key, value, offered[key])
    missing = [
        key
        for key, parameter in offered.items()
        if parameter.default is inspect.Parameter.empty and key not in found
    ]
    if missing:
        raise PolicyError(f"{name} needs a value for {missing[0]}: --policy-arg {missing[0]}=VALUE")
    return found


def settings(
    make: Callable[..., Any], chosen: Mapping[str, Any], fixed: Collection[str] = ()
) -> dict[str, Any]:
    """Every plain parameter of `make` by name, chosen or by default, for a result's header.

    Those in `fixed` are left out.
    """
    values = {key: parameter.default for key, parameter in _offered(make).items()} | dict(chosen)
    return {
        key: value
        for key, value in values.items()
        if isinstance(value, _READABLE) and key not in fixed
    }


def accepted(make: Callable[..., Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Those of `values` that `make` takes by name."""
    return {key: values[key] for key in _offered(make) if key in values}


def _offered(make: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """Parameters that can be given by name, each with its annotation resolved where that is
    possible."""
    try:
        parameters = inspect.signature(make).parameters
    except (TypeError, ValueError):  # written in C, without a signature
        return {}
    try:
        hints = typing.get_type_hints(make.__init__ if inspect.isclass(make) else make)
    except Exception:  # an annotation that names something not imported at run time
        hints = {}
    named = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    return {
        key: parameter.replace(annotation=hints.get(key, parameter.annotation))
        for key, parameter in parameters.items()
        if parameter.kind in named
    }


def _value(name: str, key: str, text: str, parameter: inspect.Parameter) -> Any:
    kinds = _kinds(parameter)
    if not kinds:
        raise PolicyError(
            f"--policy-arg {key}: {name} takes no int, float, bool or str there,"
            " so it cannot be given on the command line"
        )
    for kind in kinds:
        try:
            return _as(kind, text)
        except ValueError:
            continue
    wanted = " or ".join(kind.__name__ for kind in kinds)
    raise PolicyError(
        f"--policy-arg {key}: expected a value of type {wanted}, got {text}"
    ) from None


def _kinds(parameter: inspect.Parameter) -> list[type]:
    annotation = parameter.annotation
    if annotation in (inspect.Parameter.empty, Any):
        default = parameter.default
        if default is inspect.Parameter.empty or default is None:
            return [str]
        return [kind for kind in _READABLE if type(default) is kind]
    if isinstance(annotation, str):  # could not be resolved
        return [kind for kind in _READABLE if kind.__name__ == annotation]
    members = typing.get_args(annotation) or (annotation,)
    return [kind for kind in _READABLE if kind in members]


def _as(kind: type, text: str) -> Any:
    if kind is bool:
        if text.lower() in _TRUE or text.lower() in _FALSE:
            return text.lower() in _TRUE
        raise ValueError
    value = kind(text)
    if kind is float and not math.isfinite(value):
        raise ValueError
    return value
