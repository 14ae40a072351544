"""All commands, in the order in which a newcomer meets them, and how tyro reads them."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, Union, cast

if TYPE_CHECKING:
    from retrue.cli.command import Command

DESCRIPTION = "Recalibrate a camera-projector rig from one picture, and know how sure the answer is."
EXAMPLES: dict[str, tuple[str, ...]] = {
    "demo": ("retrue demo --out demo-out",),
    "pattern": (
        "retrue pattern color-grid --projector-size 1024 768 --out pattern",
        "retrue pattern gray-code --projector-size 1920 1080 --out pattern",
        "retrue pattern phase-shift --projector-size 1920 1080 --out pattern",
        "retrue pattern sequence --layout sltk --projector-size 1280 800 --out pattern",
    ),
    "board": (
        "retrue board chessboard:9x7:22mm --paper A4 --out board.pdf",
        "retrue board charuco:10x7:25mm:18mm:DICT_5X5_100 --paper A3 --out board.svg",
    ),
    "project": (
        "retrue project pattern/pattern.json --screen 1",
        "retrue project gray/pattern_*.png --screen 1 --seconds 0.5",
    ),
    "capture": ("retrue capture setup.toml --pattern pattern.json --out capture",),
    "decode": ("retrue decode wall.jpg --pattern pattern.json --out points.csv",),
    "calibrate": (
        "retrue calibrate capture_*/ --pattern pattern.json \\\n      --board chessboard:7x9:75mm --out rig.json",
    ),
    "recalibrate": (
        "retrue recalibrate rig.json wall.jpg --pattern pattern.json --out new.json",
        "retrue recalibrate rig.json points.csv --in-place --report page.html",
    ),
    "verify": ("retrue verify rig.json wall.jpg --pattern pattern.json",),
    "reconstruct": (
        "retrue reconstruct rig.json scene.jpg --pattern pattern.json --out cloud.ply",
        "retrue reconstruct rig.json scene.jpg --pattern pattern.json \\\n      --out cloud.ply --mesh part.stl",
    ),
    "merge": (
        "retrue merge view_*.ply --out object.ply --mesh object.stl",
        "retrue merge view_*.ply --turntable 12 --out object.ply",
    ),
    "accept": (
        "retrue accept rig.json position_*.jpg --pattern pattern.json \\\n"
        "      --artefact spheres:25mm:150.012mm --max-spacing 0.1 --out test.pdf",
    ),
    "scale": (
        "retrue scale rig.json scene.jpg --pattern pattern.json \\\n"
        "      --known points:120mm --click 412 300 655 310 --out scaled.json",
        "retrue scale rig.json cloud.ply --known sphere:25.4mm \\\n      --at 12.1 -40.3 812 --out scaled.json",
    ),
    "view": ("retrue view rig.json cloud.ply",),
    "studio": ("retrue studio --simulated", "retrue studio setup.toml --port 8090"),
    "watch": (
        "retrue watch rig.json incoming/ --pattern pattern.json --out watch-out",
        "retrue watch fleet.toml --out watch-out",
    ),
    "batch": ("retrue batch job.toml --report page.html",),
    "rescan": ("retrue rescan job.toml --since 2026-11-24T06:00",),
    "history": ("retrue history rig.json --plot drift.png",),
    "rollback": ("retrue rollback rig.json 3",),
    "diff": ("retrue diff rig.json new.json --working-distance 1500",),
    "export": (
        "retrue export rig.json wall.jpg --pattern pattern.json --to colmap --out scene",
        "retrue export rig.json --to ros --out retrue_description",
    ),
    "warp": ("retrue warp rig.json wall.jpg --pattern p.json --picture film.png --out warped",),
    "convert": ("retrue convert rig.json stereo.yml --to procam-calibration",),
    "simulate": ("retrue simulate clutter --rig rig.json --pattern pattern.json --out made",),
    "experiment": ("retrue experiment noise --out experiment-out",),
    "completion": (
        "retrue completion bash > ~/.local/share/bash-completion/completions/retrue",
        "retrue completion zsh > ~/.zfunc/_retrue   # a folder on $fpath",
        "retrue completion fish > ~/.config/fish/completions/retrue.fish",
    ),
}


def command_kind(name: str) -> type[Command]:
    """The class of a command; no other command's file is imported: `watch` is the class `Watch` of cli/watch.py."""
    return cast("type[Command]", getattr(import_module(f"retrue.cli.{name}"), name.capitalize()))


def call_tyro(arguments: Sequence[str]) -> Command:
    """What tyro makes of the arguments; ends in `SystemExit` where it prints help, or complains.

    Where they start with the name of a command, only that one is read: to build the parsers of all takes longer than
    most of what a command does.
    """
    import tyro

    from retrue.cli.known_distance import registry

    kinds: Any
    name, *words = arguments
    if name in EXAMPLES:
        kinds, prog, description = command_kind(name), f"retrue {name}", None
    else:
        choices = tuple(Annotated[command_kind(name), tyro.conf.subcommand(name)] for name in EXAMPLES)
        kinds, prog, description = Union[choices], "retrue", DESCRIPTION  # noqa: UP007 - of a tuple made at run time
        words = list(arguments)
    command = tyro.cli(
        kinds,
        prog=prog,
        description=description,
        args=words,
        config=(tyro.conf.FlagCreatePairsOff,),
        registry=registry,
    )
    return cast("Command", command)
