"""`python -m tests.docs [PAGE...]`: run the examples, and write what they print and draw into the pages."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from tests.docs.alike import same_picture, same_text
from tests.docs.pages import ROOT, Example, examples, pages, pictures
from tests.docs.sandbox import Sandbox

WIDTH = 1200  # pixels


def main(arguments: Sequence[str]) -> None:
    """Renew the pages that are named, else all; what still holds is left as it is."""
    for page in [Path(name).resolve() for name in arguments] or pages():
        with tempfile.TemporaryDirectory() as folder:
            renew(page, Path(folder))


def renew(page: Path, folder: Path) -> None:
    """One page, with what its examples leave in the folder."""
    before = page.read_text(encoding="utf-8")
    sandbox = Sandbox(folder)
    after, done = "", 0
    for example in examples(before):
        printed = sandbox.run(example)
        if not same_text(example.output or "", printed, exact=True):
            after += before[done : example.start] + _written(example, printed)
            done = example.end
            print(f"{page.relative_to(ROOT)}: {example.source.splitlines()[0]}")
    page.write_text(after + before[done:], encoding="utf-8")
    for shown in pictures(before):
        drawn, kept = sandbox.drawn(shown), page.parent / shown
        if drawn is not None and not (kept.is_file() and same_picture(drawn, kept)):
            keep(drawn, kept)
            print(f"{page.relative_to(ROOT)}: {shown}")


def keep(drawn: Path, kept: Path) -> None:
    """The picture in a fraction of its bytes: a page shows no more than this."""
    kept.parent.mkdir(parents=True, exist_ok=True)
    with Image.open(drawn) as picture:
        picture.thumbnail((WIDTH, WIDTH))
        picture.convert("RGB").quantize(256, Image.Quantize.FASTOCTREE).save(kept, optimize=True)


def _written(example: Example, printed: str) -> str:
    """The output as it stands in the page: below a console command, or in a block of its own."""
    text = printed if printed.endswith("\n") or not printed else printed + "\n"
    return f"```\n```text\n{text}" if example.output is None else text


if __name__ == "__main__":
    main(sys.argv[1:])
