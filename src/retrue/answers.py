"""What the jobs answer, in one shape: a verdict in a word, a sentence, and the typed cause where it is a bad one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol


@dataclass(frozen=True, slots=True)
class Reason:
    """Root of all causes; `str` of one is a sentence for the user and says what to do, the type is for programs."""

    @property
    def name(self) -> str:
        """The type's name, as files and JSON give it."""
        return type(self).__name__


class Answer(Protocol):
    """`cause` is None where the verdict is the one that was hoped for; else `reason` is its sentence."""

    @property
    def verdict(self) -> str:
        """In one word."""
        ...

    @property
    def cause(self) -> Reason | None:
        """Why not, for programs."""
        ...

    @property
    def reason(self) -> str:
        """What the verdict rests on, for people."""
        ...


def answer_report(answer: Answer) -> dict[str, Any]:
    """How JSON, histories and the records of a watch begin."""
    cause = None if answer.cause is None else answer.cause.name
    return {"verdict": answer.verdict, "cause": cause, "reason": answer.reason}
