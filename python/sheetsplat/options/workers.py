"""The option of all processes that draw for another one."""

from typing import Annotated, TypedDict

from sheetsplat._checks import number
from sheetsplat.errors import complain, unusable
from sheetsplat.options.checks import optional
from sheetsplat.options.core import Option
from sheetsplat.options.values import Real

#: Seconds; the least are some signs of life, which workers give every half second.
WORKER_TIMEOUT, LEAST_TIMEOUT, MOST_TIMEOUT = 60.0, 2.0, 86_400.0


def timeout_of(what: str, value: object) -> float:
    """Return the seconds after which a process that gives no sign of life is given up, or InvalidInput."""
    result = number(what, value)
    if not LEAST_TIMEOUT <= result <= MOST_TIMEOUT:
        raise complain(unusable(what), f"{result:g}", f"a number from {LEAST_TIMEOUT:g} to {MOST_TIMEOUT:g}")
    return result


class WorkerOptions(TypedDict, total=False):
    """How processes that draw for another one are looked after."""

    worker_timeout: Annotated[
        float | None,
        Option(
            "Seconds without a sign of life after which a process that draws for this one, a worker of a client or one "
            "of a film, is given up: other workers of the client draw its bricks; without any, and for films, an error "
            "names it. Those that are busy give signs of life. At least 2.",
            unset=f"{WORKER_TIMEOUT:g}, or what this client was given before",
            check=optional(timeout_of),
            value=Real(most=MOST_TIMEOUT),
        ),
    ]
