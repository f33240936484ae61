"""What a part of the command is: numbered cases, a judgement of each, and how a failure is made smaller."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from fuzz.cases import Case


@dataclass(frozen=True)
class Outcome:
    """The judgement of a case.

    Attributes
    ----------
    verdict
        "right", "wrong", or the class of the error by which it was refused.
    what
        Of a wrong one: the kind of failure; failures of one kind are most likely of one cause.
    text
        Of a wrong one: what was found.
    """

    verdict: str
    what: str = ""
    text: str = ""

    @property
    def is_wrong(self) -> bool:
        """Whether the case failed."""
        return self.verdict == "wrong"


RIGHT = Outcome("right")


class Part(ABC):
    """A part of the command. Parts are sent to child processes, so they must be picklable."""

    #: What the command line calls it.
    name: str
    #: Share of the time of a run, beside those of the other parts.
    share: float = 1.0
    #: Cases of a batch, which one process runs.
    batch: int = 100
    #: Processor time that a case may take, in seconds.
    seconds: float = 20.0
    #: Seconds that a case may take, waiting included.
    patience: float = 300.0
    #: Bytes that the process may have in memory.
    memory: int = 2 << 30
    #: The seed of the first case, unless the command line has one.
    first: int = 0
    #: Failures of one kind that are made smaller and kept.
    most_kept: int = 3

    @property
    @abstractmethod
    def kinds(self) -> Mapping[str, float]:
        """The kinds of cases, each with its share of them."""

    def prepare(self, folder: Path) -> None:  # noqa: B027
        """Make once, before all children, what they share; `folder` is the output's."""

    @abstractmethod
    def case(self, kind: str, seed: int) -> Case:
        """Return a case, always the same of a seed."""

    @abstractmethod
    def run(self, case: Case, folder: Path) -> Outcome:
        """Judge a case; `folder` is empty at first. Whatever is raised is a failure."""

    @abstractmethod
    def shrunk(self, case: Case, wrong: Callable[[Case], bool]) -> Case:
        """Return as small a case as is found for which `wrong` is still true."""
