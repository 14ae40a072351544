"""The scripts that complete a command line, in the shells that are here."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from retrue.cli.main import main


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("retrue pattern co", {"color-grid"}),
        ("retrue experiment p", {"peers"}),
        ("retrue completion ", {"bash", "zsh", "fish"}),
        ("retrue veri", {"verify"}),
        ("retrue verify --patt", {"--pattern"}),
        ("retrue verify rig.json --pattern pat", {"pattern.json"}),
        ("retrue verify ri", set()),  # nothing of ours: then bash completes files, as it was asked to
    ],
)
def test_bash_completes_commands_options_choices_and_files(
    words: str, expected: set[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    for name in ("rig.json", "pattern.json"):
        (tmp_path / name).touch()
    *before, current = words.split(" ")
    array = " ".join(f"'{word}'" for word in (*before, current))
    line = f"COMP_WORDS=({array}); COMP_CWORD={len(before)}; COMP_LINE='{words}'; COMP_POINT={len(words)}"
    shown = "printf '%s\\n' \"${COMPREPLY[@]}\"\ncomplete -p retrue"
    ask = f"{script}\n{line}\n_retrue retrue '{current}' '{before[-1]}'\n{shown}"
    done = subprocess.run(["bash", "--norc"], input=ask, capture_output=True, text=True, cwd=tmp_path, check=True)
    *found, registered = done.stdout.split("\n")[:-1]
    assert {word.strip() for word in found} - {""} == expected
    assert registered == "complete -o default -F _retrue retrue"


def test_fish_offers_files_and_choices(capsys: pytest.CaptureFixture[str]):
    assert main(["completion", "fish"]) == 0
    script = capsys.readouterr().out
    assert "--no-files" not in script
    assert (
        "'__fish_seen_subcommand_from pattern' --arguments 'color-grid line-grid gray-code phase-shift sequence'"
        in script
    )
