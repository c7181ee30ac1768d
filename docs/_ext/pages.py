"""Pages that the installed package writes itself: scenario keys, metrics, commands, bundled scenarios."""

from __future__ import annotations

import re
import shutil
import warnings
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner
from matplotlib.axes import Axes
from sphinx.application import Sphinx
from sphinx_gallery.scrapers import figure_rst

import vffnull as vff
from vffnull import _core
from vffnull.cli import _commands
from vffnull.draw import geometry, style
from vffnull.draw.figures import canvas, space, strobe
from vffnull.draw.figures.render import Canvas
from vffnull.draw.primitives import Marks
from vffnull.draw.scene import Scene
from vffnull.model.record import QUANTITIES
from vffnull.model.scenario import read

RULE = re.compile(r"^ *-{2,}( +-{2,})+ *$")


class Order:
    """The gallery's order: what the package is for first, then by name."""

    FIRST = (
        "hold_pose",
        "look_ahead",
        "give_way",
        "sweep_through",
        "follow_line",
        "own_loop",
        "plan_and_react",
    )

    def __init__(self, folder: str) -> None:
        self.folder = folder

    def __call__(self, file: str) -> tuple[int, str]:
        name = Path(file).stem
        return (self.FIRST.index(name) if name in self.FIRST else len(self.FIRST), name)


Shown = tuple[str, dict[str, Any]]
"""A bundled scenario, and what is changed of it."""

# What the gallery shows of an example that has no run of its own.
SCENES: dict[str, Shown] = {
    "design_gains": ("sweep-through", {"obstacles.0.motion.velocity": [0.0, -2.0], "duration": 0.7}),
    "give_way": ("ur5e-crossed", {"duration": 3.1}),
    "gym_our_controller": ("sweep-through", {"controller.field.gain": 0.0}),
    "gym_random_policy": ("sweep-through", {"duration": 3.2}),
    "many_runs": ("panda-sweep", {"controller.field.gain": 20.0, "duration": 4.0}),
    "mujoco_plant": ("ur5e-sweep", {"controller.field.gain": 0.0, "duration": 3.0}),
    "own_loop": ("panda-sweep", {"controller.task": "position", "duration": 3.0}),
    "report": ("panda-sweep", {"duration": 5.0}),
    "robustness": ("paper-2-moving", {}),
    "tune": ("crowd", {"duration": 3.0}),
}
# What the list of tutorials shows of each.
TUTORIALS: dict[str, Shown] = {
    "ten-minutes": ("gen3-circle", {}),
    "live": ("panda-cup", {"duration": 3.0}),
    "hold": ("sweep-through", {}),
    "follow": ("narrow-gap", {}),
    "own-loop": ("paper-1", {}),
    "own-field": ("pincer", {}),
    "gains": ("sweep-through", {"obstacles.0.motion.velocity": [0.0, -2.0], "duration": 0.7}),
    "limits": ("paper-1-ramp", {}),
    "real-arm": ("ur5e-sweep", {}),
    "touch": ("panda-bump", {"duration": 6.0}),
    "camera": ("panda-sweep", {"duration": 4.0}),
    "recordings": ("panda-watched", {"duration": 2.0}),
    "many-runs": ("panda-sweep", {"controller.field.gain": 20.0}),
    "studies": ("crowd", {"duration": 3.0}),
    "urdf": ("iiwa-line", {}),
    "bring-your-arm": ("head-on", {}),
    "from-osc": ("ur5e-crossed", {}),
}
STRICT = ExitStack()
"""What ends with an example."""
THUMBNAIL = 2.4, 1.5  # in: small, so that lines are thick


def thumbnail(result: vff.Result, path: str | Path) -> None:
    """Draw what moves in a run: plots of its results cannot be read at that size."""
    scene = Scene.of_result(result)
    with style.look():
        fig = style.figure(THUMBNAIL[1], THUMBNAIL[0])
        ax = fig.add_axes((0.0, 0.0, 1.0, 1.0))
        fig.set_layout_engine("none")
        (in_space if scene.dimension == 3 else in_the_plane)(ax, scene)
        ax.set_axis_off()
        fig.savefig(path, dpi=200)


def in_the_plane(ax: Axes, scene: Scene) -> None:
    """A few instants, the axes filled and to scale."""
    when = scene.instants(4)
    strobe.draw(ax, scene, list(when), strobe.shades(len(when)))
    canvas.paint(ax, [Marks("target", scene.reference[-1:])], colour=style.INK, zorder=6)
    canvas.paint(ax, scene.at(0, ["base"]), zorder=2.5)
    low, high = scene.frame()
    scale = float(((high - low) / THUMBNAIL).max())  # m per inch
    spare = (scale * np.array(THUMBNAIL) - (high - low)) / 2
    ax.set_xlim(low[0] - spare[0], high[0] + spare[0])
    ax.set_ylim(low[1] - spare[1], high[1] + spare[1])


def in_space(ax: Axes, scene: Scene) -> None:
    """The arm among its obstacles at the end, and faintly before."""
    layers = space.passing_layers(scene, *space.moments(scene, 3))
    view = geometry.looking(space.AZIMUTH, space.ELEVATION)
    picture = Canvas.around(layers, view, scene.reach / 600)
    ax.imshow(picture.draw(layers), extent=picture.extent, origin="lower", interpolation="antialiased")


def pictured(name: str) -> vff.Result:
    """The run that stands for an example."""
    scenario, changes = SCENES[name]
    return vff.simulate(scenario, changes)


def warnings_as_errors(conf: dict[str, Any], file: str | None, when: str) -> None:
    """For the gallery: a warning ends an example."""
    if when == "before" and file is not None:
        STRICT.enter_context(warnings.catch_warnings())
        warnings.simplefilter("error")
    elif when == "after":
        STRICT.close()


def written_files(block: Any, variables: dict[str, Any], conf: dict[str, Any]) -> str:
    """For the gallery: pictures and pages that an example has written beside itself, moved away. The first
    picture is the thumbnail, and is shown nowhere else.
    """
    source = Path(variables["src_file"])
    folder, found = source.parent, []
    if block.type == "code":
        example = source.stem
        if not (folder / f"{example}.png").read_bytes().startswith(b"\x89PNG"):
            raise ValueError(f"{example}.png is no picture")
        result = pictured(example) if example in SCENES else vars(variables["fake_main"])["result"]
        thumbnail(result, next(variables["image_path_iterator"]))
    for picture in sorted(folder.glob("*.png")):
        found.append(next(variables["image_path_iterator"]))
        shutil.move(picture, found[-1])
    shown = str(figure_rst(found, conf["src_dir"]))
    for page in sorted(folder.glob("*.html")):
        shutil.move(page, Path(conf["src_dir"]) / "generated" / "written" / page.name)
        shown += f"\n`Open {page.name} <../{page.name}>`__\n"
    return shown


def table(head: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def columns(block: list[str]) -> str:
    """The schema's table of fixed width as a Markdown table; a line without a key continues the last."""
    starts = [found.start() for found in re.finditer(r"-+", block[1])]
    ends = [*starts[1:], None]
    rows: list[list[str]] = []
    for line in (block[0], *block[2:]):
        cells = [line[a:b].strip() for a, b in zip(starts, ends, strict=True)]
        if cells[0] or not rows:
            rows.append(cells)
        else:
            rows[-1] = [f"{old} {new}".strip() for old, new in zip(rows[-1], cells, strict=True)]
    return table(rows[0], [[f"`{row[0]}`", *row[1:]] for row in rows[1:]])


def keys() -> str:
    """What `vffnull schema` prints, its tables set as tables."""

    def blocks(text: str) -> Iterator[str]:
        for part in text.split("\n\n"):
            lines = part.splitlines()
            indented = len(lines) > 1 and all(line.startswith("    ") for line in lines)
            yield columns(lines) if indented and RULE.match(lines[1]) else part

    return "\n\n".join(blocks(_core.schema())) + "\n"


def quantities() -> str:
    """What a run measures and records."""
    metrics = [[f"`{name}`", unit, meaning] for name, (unit, meaning) in _core.METRICS.items()]
    recorded = [[f"`{name}`", each.unit, each.meaning] for name, each in QUANTITIES.items()]
    constants = [
        [f"`vffnull.{name}`", ", ".join(f"`{each}`" for each in getattr(vff, name))]
        for name in ("ENERGIES", "PORTS", "OBJECTIVES")
    ]
    return (
        "# Metrics and recorded quantities\n\n"
        "A metric that does not apply to a run is `None`, and so is an array that a run does not have.\n\n"
        "## Metrics\n\n`Result.metrics`, one number per run.\n\n"
        f"{table(['metric', 'unit', 'meaning'], metrics)}\n\n"
        "## Recorded quantities\n\nArrays of a `Result`, one row per recorded instant, beside the time.\n\n"
        f"{table(['array', 'unit', 'meaning'], recorded)}\n\n"
        f"## Columns with names\n\n{table(['constant', 'columns'], constants)}\n"
    )


def commands() -> str:
    """The help of every command."""
    runner = CliRunner()

    def shown(*words: str) -> str:
        text = runner.invoke(_commands, [*words, "--help"], prog_name="vffnull", terminal_width=92).output
        return f"```text\n{text.rstrip()}\n```"

    names = [
        (name, *below)
        for name, command in _commands.commands.items()
        for below in [(), *((each,) for each in getattr(command, "commands", ()))]
    ]
    parts = [f"##{'#' * (len(name) - 1)} vffnull {' '.join(name)}\n\n{shown(*name)}" for name in names]
    return "# Command line\n\n" + "\n\n".join([shown(), *parts]) + "\n"


def scenarios(pictures: Path) -> str:
    """Every bundled scenario with a picture, its numbers and its file."""
    cards, parts = [], []
    for name in vff.scenarios():
        result = vff.simulate(name)
        with style.look():
            strobe.strobe(result).savefig(pictures / f"{name}.png")
        file, metrics = f"figures/{name}.png", result.metrics
        cards.append(
            f":::{{grid-item-card}} {name}\n:img-top: {file}\n:img-alt: The arm in {name}\n"
            f":link: {name}\n:link-type: ref\n\n{result.scenario.description}.\n:::"
        )
        rows = [
            [f"`{key}`", f"{metrics[key]:.3g} {_core.METRICS[key][0]}".strip(), _core.METRICS[key][1]]
            for key in ("min_clearance", "max_error_transient", "max_error_tail", "peak_torque", "peak_speed")
            if metrics[key] is not None
        ]
        parts.append(
            f"({name})=\n## {name}\n\n{result.scenario.description}. Status: *{result.status}*.\n\n"
            f"```{{image}} {file}\n:alt: Several instants of {name}, light to dark\n:width: 460px\n```\n\n"
            f"{table(['metric', 'value', 'meaning'], rows)}\n\n"
            f":::{{dropdown}} vffnull show {name}\n```toml\n{read(name)}```\n:::"
        )
    return (
        "# Bundled scenarios\n\n`vffnull run NAME` runs one of these, "
        "`vff.simulate(NAME)` does so from Python. Light is early, dark is late.\n\n"
        "::::{grid} 1 2 3 3\n:gutter: 3\n\n" + "\n\n".join(cards) + "\n::::\n\n" + "\n\n".join(parts) + "\n"
    )


def on_builder_inited(app: Sphinx) -> None:
    """Write them all; a page that stays the same keeps its date."""
    target = Path(app.srcdir) / "generated"
    (target / "figures").mkdir(parents=True, exist_ok=True)
    for name, (scenario, changes) in TUTORIALS.items():
        thumbnail(vff.simulate(scenario, changes), target / "figures" / f"tutorial-{name}.png")
    vff.simulate("panda-sweep").animate(target / "figures" / "panda-sweep.gif", fps=15, size=560)
    pages = {
        "keys": keys(),
        "quantities": quantities(),
        "commands": commands(),
        "scenarios": scenarios(target / "figures"),
    }
    for name, text in pages.items():
        page = target / f"{name}.md"
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", on_builder_inited)
    return {"parallel_read_safe": True}
