"""Where the scenarios of a study come from: one base scenario, or families of random scenes."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from vffnull._support.errors import InputError, InputTypeError
from vffnull.evaluation.scenes import ARMS, EVALUATION, FAMILIES, TASKS, TRAINING, in_space, random
from vffnull.model.arm_files import explicit
from vffnull.model.document import Document, plain
from vffnull.model.scenario import Scenario, changed, source_of
from vffnull.studies._keyed import Keyed

__all__ = ["Base", "read_base"]

_KEPT = 64  # scenes in memory


class Base(Protocol):
    """Scenarios by number, before the factors change them."""

    count: int

    def name(self, at: int) -> str:
        """What a scenario is called; empty if there is one only."""
        ...

    def document(self, at: int, overrides: Mapping[str, Any]) -> Document:
        """A scenario with some keys changed, ready for the core. Parts are shared: it must not be changed."""
        ...

    def to_dict(self) -> Document:
        """What stands in the study's document."""
        ...


class _One:
    """One scenario."""

    count = 1

    def __init__(self, source: Document) -> None:
        self._source = source
        self._ready: Document | None = None

    def name(self, at: int) -> str:
        return ""

    def document(self, at: int, overrides: Mapping[str, Any]) -> Document:
        if any(key.partition(".")[0] == "arm" for key in overrides):
            return explicit(changed(copy.deepcopy(self._source), overrides))
        if self._ready is None:
            self._ready = explicit(copy.deepcopy(self._source))
        return with_changes(self._ready, overrides)

    def to_dict(self) -> Document:
        return {"scenario": self._source}


class _Scenes:
    """Random scenes: so many of each family and kind of arm."""

    def __init__(self, table: Keyed) -> None:
        families = table.words("families", FAMILIES)
        for i, each in enumerate(families):
            _known(f"{table.at('families')}[{i}]", each, FAMILIES)
        if not families:
            raise InputError(f"{table.at('families')}: expected at least one of {', '.join(FAMILIES)}")
        self._families = list(dict.fromkeys(families))
        self._each = table.whole("count", None, 1, len(TRAINING))
        self._first = table.whole("first_seed", TRAINING.start, 0, EVALUATION.stop - self._each)
        self._kinds: dict[str, list[Any]] = {}
        makers: list[Callable[[int], Scenario]]
        if "arms" in table or "tasks" in table:
            if "joints" in table:
                raise InputError(f"{table.at('joints')}: is of scenes in the plane, `arms` of those in space")
            arms, tasks = table.words("arms", ("panda",)), table.words("tasks", ("position",))
            for key, given, known in (("arms", arms, ARMS), ("tasks", tasks, TASKS)):
                for i, each in enumerate(given):
                    _known(f"{table.at(key)}[{i}]", each, known)
            self._kinds = {"arms": list(arms), "tasks": list(tasks)}
            makers = [partial(in_space, f, a, t) for f in self._families for a in arms for t in tasks]
        else:
            joints = [_joints(table, i, each) for i, each in enumerate(table.rows("joints", (6,)))]
            self._kinds = {"joints": joints}
            makers = [partial(random, family, n) for family in self._families for n in joints]
        self._makers = makers
        self.count = len(makers) * self._each
        if not self.count:
            raise InputError(
                f"{table.path}: there is no scene: no arm, no task or no number of joints is given"
            )
        self._ready: dict[int, Document] = {}

    def _made(self, at: int) -> Document:
        made = self._ready.get(at)
        if made is None:
            kind, place = divmod(at, self._each)
            made = self._makers[kind](self._first + place).to_dict()
            if len(self._ready) >= _KEPT:
                self._ready = {}  # a new one: other threads may be reading the old
            self._ready[at] = made
        return made

    def name(self, at: int) -> str:
        return str(self._made(at)["name"])

    def document(self, at: int, overrides: Mapping[str, Any]) -> Document:
        if any(key.partition(".")[0] == "arm" for key in overrides):
            return explicit(changed(copy.deepcopy(self._made(at)), overrides))
        return with_changes(self._made(at), overrides)

    def to_dict(self) -> Document:
        kinds = {"families": self._families, **self._kinds}
        return {"scenes": {**kinds, "count": self._each, "first_seed": self._first}}


def with_changes(document: Document, overrides: Mapping[str, Any]) -> Document:
    """A document with other values for some keys; tables in which nothing changes are shared, not copied."""
    tops = {key.partition(".")[0].partition("[")[0] for key in overrides}
    own = {key: copy.deepcopy(value) if key in tops else value for key, value in document.items()}
    return changed(own, overrides)


def read_base(table: Keyed, folder: Path) -> Base:
    """The base of a study: ``scenario``, a name, a path beside the study or a table; or ``[scenes]``."""
    if table.one_of("scenario", "scenes") == "scenes":
        allowed = ("families", "joints", "arms", "tasks", "count", "first_seed")
        return _Scenes(Keyed(table.get("scenes"), "scenes", allowed))
    given = table.get("scenario")
    if isinstance(given, str):
        return _One(source_of(folder / given if given.endswith(".toml") else given))
    if isinstance(given, Scenario):
        return _One(given.to_dict())
    if isinstance(given, Mapping):
        return _One(plain(given, "scenario"))
    raise InputTypeError(f"scenario: expected a name, a path or a table, got {type(given).__name__}")


def _known(path: str, value: str, known: Iterable[str]) -> None:
    if value not in known:
        raise InputError(f"{path}: no {value!r}; expected some of {', '.join(known)}")


def _joints(table: Keyed, i: int, value: Any) -> int:
    from vffnull._support.arguments import whole

    return whole(f"{table.at('joints')}[{i}]", value, 3, 12)
