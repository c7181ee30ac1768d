"""What the pages of runs and of studies have in common: a frame with style and drawing library inside."""

from __future__ import annotations

from pathlib import Path

from bokeh.resources import Resources
from jinja2 import Environment, FileSystemLoader, StrictUndefined

__all__ = ["fill"]

_HERE = Path(__file__).parent


def fill(template: Path, **values: object) -> str:
    """The whole page that a template makes of values. Text in them is data, never markup."""
    environment = Environment(
        loader=FileSystemLoader([template.parent, _HERE]),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
    )
    return environment.get_template(template.name).render(
        values,
        bokeh=Resources(mode="inline", components=["bokeh"]).render(),
        style=(_HERE / "page.css").read_text(encoding="utf-8"),
    )
