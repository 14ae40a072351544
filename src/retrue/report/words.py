"""Reasons as sentences."""

from __future__ import annotations


def problem_and_advice(reason: str) -> tuple[str, tuple[str, ...]]:
    """Our reasons read "what is wrong; what to do": both as sentences.

    >>> problem_and_advice("no plane among 80 points; have a wall fill part of the picture")
    ('No plane among 80 points.', ('Have a wall fill part of the picture.',))
    """
    problem, *advice = reason.split("; ")
    return sentence(problem), tuple(sentence(part) for part in advice)


def sentence(text: str) -> str:
    """With a capital and a full stop."""
    text = text.strip()
    text = text[:1].upper() + text[1:]
    return text if text.endswith((".", "?", "!")) else f"{text}."


def listed(parts: list[str]) -> str:
    """One, two and three.

    >>> listed(["a plane", "a ball", "a box"])
    'a plane, a ball and a box'
    """
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
