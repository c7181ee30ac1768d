"""Scenarios: an arm, its task, its controller and its surroundings, in one document."""

from __future__ import annotations

import copy
import os
import re
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import vffnull._core as _core
from vffnull._support.arguments import suggesting
from vffnull._support.errors import InputError, InputTypeError, ScenarioError
from vffnull.model.arm import arm_of
from vffnull.model.arm_files import anchored, explicit
from vffnull.model.document import Document, HasDocument, frozen, get, plain, put

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = [
    "Scenario",
    "ScenarioLike",
    "changed",
    "document_of",
    "prepare",
    "read",
    "scenarios",
    "source_of",
    "with_hint",
]

_BUNDLED = Path(__file__).parents[1] / "scenarios"


@suggesting
class Scenario:
    """A scenario, ready to run. It cannot be changed; `replace` makes another one.

    Parameters
    ----------
    arm : Arm or dict
        The arm; ``{"model": "panda"}`` is a bundled one, ``{"urdf": "robot.urdf", "tip": "tool0"}`` is read,
        ``{"mjcf": "robot.xml"}`` too, and the scenario holds what was read.
    q0 : (n,) array_like
        Joint angles at the start [rad].
    duration : float
        How long to simulate [s].
    reference : dict
        What the end effector has to follow, for instance ``{"kind": "setpoint", "point": [2.8, 1.6]}``.
    controller : ControlSettings or dict, optional
        The control law's settings.
    obstacles : Obstacle, dict, or iterable of them, optional
        What stands in the way.
    simulation : dict, optional
        Step size, integrator, sampling of the controller, recording.
    name, description : str, optional
        For lists and titles.
    dq0 : (n,) array_like, optional
        Joint velocities at the start [rad/s]; at rest by default.
    plant : dict, optional
        What the physical arm is where it differs from `arm`, the controller's model: masses, payload,
        friction, stops.
    measurement : dict, optional
        Noise, resolution and delay of the controller's sensors; by default it knows the state.
    perception : dict, optional
        Range sensors for the obstacles; by default the controller knows them.
    actuator : dict, optional
        Lag of the drives; by default the torque acts as commanded.
    seed : int, optional
        Where the random numbers come from; 0 by default.
    replan : dict, optional
        Searches for a plan where the reference leads nowhere; ``{}`` takes every default.
    wrenches : Wrench, dict, or iterable of them, optional
        What pushes the physical arm from outside.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario cannot be run; the message names the key, what was given, and what is allowed.

    See Also
    --------
    Scenario.load : the bundled scenarios and TOML files.

    Notes
    -----
    ``vffnull schema`` prints every key with its unit, default and meaning.

    Examples
    --------
    >>> scenario = Scenario.load("paper-1").replace(duration=5.0, **{"controller.field.gain": 2.0})
    >>> scenario["controller.field.gain"]
    2.0
    """

    __slots__ = ("_document",)
    _document: Document

    def __init__(
        self,
        *,
        arm: HasDocument | Mapping[str, Any],
        q0: ArrayLike,
        duration: float,
        reference: Mapping[str, Any],
        controller: HasDocument | Mapping[str, Any] | None = None,
        obstacles: HasDocument | Mapping[str, Any] | Iterable[HasDocument | Mapping[str, Any]] = (),
        simulation: Mapping[str, Any] | None = None,
        name: str | None = None,
        description: str | None = None,
        dq0: ArrayLike | None = None,
        plant: Mapping[str, Any] | None = None,
        measurement: Mapping[str, Any] | None = None,
        perception: Mapping[str, Any] | None = None,
        actuator: Mapping[str, Any] | None = None,
        seed: int | None = None,
        replan: Mapping[str, Any] | None = None,
        wrenches: HasDocument | Mapping[str, Any] | Iterable[HasDocument | Mapping[str, Any]] = (),
    ) -> None:
        self._document = plain(
            {
                "name": name,
                "description": description,
                "duration": duration,
                "q0": q0,
                "dq0": dq0,
                "arm": arm,
                "controller": controller,
                "reference": reference,
                "obstacles": _several(obstacles) or None,
                "simulation": simulation,
                "plant": plant,
                "wrenches": _several(wrenches) or None,
                "measurement": measurement,
                "perception": perception,
                "actuator": actuator,
                "replan": replan,
                "seed": seed,
            }
        )
        self._document = _checked(self._document)

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> Scenario:
        """Make a scenario of a document, the same as a TOML file holds.

        Parameters
        ----------
        document : Mapping
            The scenario's tables and keys; objects such as `Arm` and `Field` may stand for tables.

        Raises
        ------
        vffnull.errors.ScenarioError
            If the scenario cannot be run.
        """
        return cls._of(_checked(plain(document)))

    @classmethod
    def load(cls, source: str | os.PathLike[str]) -> Scenario:
        """Load a bundled scenario by its name, or a TOML file by its path.

        Parameters
        ----------
        source : str or path
            One of `scenarios()`, or a path that ends in ``.toml``.

        Raises
        ------
        vffnull.errors.ScenarioError
            If there is no such scenario, or if it cannot be run.
        """
        document = _written(source)
        with _naming(source):
            return cls.from_dict(document)

    @classmethod
    def _of(cls, document: Document) -> Scenario:
        """A scenario of a document that has been checked before."""
        scenario = cls.__new__(cls)
        scenario._document = document
        return scenario

    @property
    def name(self) -> str:
        """The scenario's name, or an empty string."""
        return str(self._document.get("name", ""))

    @property
    def description(self) -> str:
        """One line about the scenario, or an empty string."""
        return str(self._document.get("description", ""))

    @property
    def duration(self) -> float:
        """How long it runs [s]."""
        return float(self._document["duration"])

    @property
    def arm(self) -> _core.Arm:
        """The arm, as the controller knows it."""
        found: _core.Arm = arm_of(self._document["arm"])
        return found

    @property
    def plant(self) -> _core.Arm:
        """The physical arm: `arm` with what ``[plant]`` changes of it, payload included."""
        return _core.plant(self._document)

    def to_dict(self) -> Document:
        """The document, as a copy of its own."""
        document: Document = plain(self._document)
        return document

    def replace(self, **names: Any) -> Scenario:
        """Make a scenario that differs in some keys.

        Parameters
        ----------
        **names : value
            Keys and new values. Dotted names, unpacked from a dictionary, reach into tables and lists, as in
            ``replace(**{"controller.field.gain": 2.0, "obstacles.0.position": [1, 2]})``. Objects such as
            `Arm`, `Obstacle` and `Field` may stand for tables. None removes a key.

        Raises
        ------
        vffnull.errors.ScenarioError
            If the result cannot be run.
        """
        return prepare(self, names)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the scenario to a TOML file.

        Parameters
        ----------
        path : str or path
            Ends in ``.toml``: nothing else is loaded again.

        Raises
        ------
        vffnull.errors.ScenarioError
            If it has another ending, as the file of an arm has, which is left as it is.
        """
        if not os.fspath(path).endswith(".toml"):
            raise _misnamed(path)
        from vffnull._support.files import replacing

        with replacing(Path(path)) as draft:
            draft.write_text(str(self), encoding="utf-8")

    def __getitem__(self, name: str) -> Any:
        """The value of a key, by its dotted name; a copy."""
        return plain(get(self._document, name))

    def __eq__(self, other: object) -> bool:
        return self._document == other._document if isinstance(other, Scenario) else NotImplemented

    def __hash__(self) -> int:
        return hash(frozen(self._document))

    def __str__(self) -> str:
        return _core.format_toml(self._document)

    def _repr_html_(self) -> str | None:
        from vffnull._support import representation

        return representation.html(self)

    def __repr__(self) -> str:
        parts = [
            f"{len(self._document['q0'])} joints",
            f"{self._document['reference']['kind']} reference",
            f"{len(self._document.get('obstacles', ()))} obstacles",
            f"{self.duration:g} s",
        ]
        return f"<Scenario {self.name or 'without a name'}: {', '.join(parts)}>"


_LISTS = ("obstacles", "wrenches")
"""Keys of which there may be several."""


def _several(given: HasDocument | Mapping[str, Any] | Iterable[Any]) -> list[Any]:
    """One or several as a list."""
    return [given] if isinstance(given, HasDocument | Mapping) else list(given)


ScenarioLike = str | os.PathLike[str] | Mapping[str, Any] | Scenario
"""What `simulate` accepts: a bundled name, a path to a TOML file, a document, or a scenario."""


def scenarios() -> list[str]:
    """Names of the bundled scenarios."""
    return sorted(path.stem for path in _BUNDLED.glob("*.toml"))


def read(source: str | os.PathLike[str]) -> str:
    """The text of a bundled scenario or of a TOML file, comments included.

    Raises
    ------
    vffnull.errors.ScenarioError
        If there is no such scenario or file.
    """
    name = os.fspath(source) if isinstance(source, str | os.PathLike) else None
    if not isinstance(name, str):
        raise InputTypeError(
            f"scenario: expected a name, a path, a dict or a Scenario, not a {type(source).__name__}"
        )
    if name.endswith(".toml"):
        from vffnull._support.files import read_text

        try:
            text = read_text(Path(name))
        except UnicodeDecodeError:
            raise ScenarioError(f"{shown(name)}: not a TOML file, the text is not UTF-8") from None
        except InputError as error:
            raise ScenarioError(shown(str(error))) from None
        except (OSError, ValueError) as error:  # a ValueError if the path holds a null character
            encoding = isinstance(error, UnicodeEncodeError)
            reason = "no path of this system" if encoding else getattr(error, "strerror", None) or str(error)
            raise ScenarioError(f"{shown(name)}: cannot be read: {reason.lower()}") from None
        if not text.strip():
            raise ScenarioError(f"{shown(name)}: the file is empty")
        return text
    bundled = scenarios()
    if name in bundled:
        return (_BUNDLED / f"{name}.toml").read_text(encoding="utf-8")
    if os.path.isfile(name):
        raise _misnamed(name)
    import difflib

    near = difflib.get_close_matches(name, bundled, n=1)
    hint = f" (did you mean {near[0]!r}?)" if near else ""
    raise ScenarioError(
        f"no scenario called {shown(name[:100])!r}{hint}; bundled are {', '.join(bundled)}; "
        "the path of a file ends in .toml"
    )


def _misnamed(path: str | os.PathLike[str]) -> ScenarioError:
    return ScenarioError(f"{shown(path)}: the name of a scenario file ends in .toml")


def prepare(scenario: ScenarioLike, overrides: Mapping[str, Any] | None = None) -> Scenario:
    """The scenario that is meant, with the overrides applied before anything is checked."""
    check_overrides(overrides)
    if isinstance(scenario, Scenario) and not overrides:
        return scenario
    document = source_of(scenario)
    before = copy.deepcopy(document) if overrides else document
    try:
        with nullcontext() if overrides else _naming(scenario):  # an override may be at fault
            return Scenario.from_dict(changed(document, overrides))
    except ScenarioError as error:
        raise with_hint(error, overrides or {}, before) from None


def with_hint(error: ScenarioError, overrides: Mapping[str, Any], document: Document) -> ScenarioError:
    """The error with the keys that may have been meant, if an override's key is unknown."""
    from vffnull.model.keys import nearest

    message = str(error)
    for name in overrides:
        last = name.rpartition(".")[2]
        if f"unknown key `{last}`" not in message:
            continue
        near = nearest(name, document)
        if "did you mean" in message and not any(each.endswith(f".{last}") for each in near):
            continue  # the core has found a better one
        if near:
            message = re.sub(r", did you mean `\w+`\? Allowed", "; allowed", message)
            return ScenarioError(f"{message}; did you mean {' or '.join(near)}?", error.path)
    return error


def check_overrides(overrides: object) -> None:
    """Refuse what is not a dictionary."""
    if overrides is not None and not isinstance(overrides, Mapping):
        raise InputTypeError(f"overrides: expected a dict of dotted names, not a {type(overrides).__name__}")


def source_of(scenario: ScenarioLike) -> Document:
    """The document of what is meant as it is written, unchecked, as a copy of its own.

    A URDF that it names beside its own file is named by its whole path; `explicit` reads it.
    """
    if isinstance(scenario, Scenario):
        return scenario.to_dict()
    if isinstance(scenario, Mapping):
        document: Document = plain(scenario)
        return document
    return _written(scenario)


def _written(source: str | os.PathLike[str]) -> Document:
    """The document of a bundled scenario or of a TOML file, as it is written."""
    from vffnull.model.toml_text import parsed  # loaded when a file is read

    return anchored(parsed(read(source), shown(source)), _folder(source))


def _naming(source: object) -> AbstractContextManager[None]:
    """What is wrong with a scenario in a file of one's own begins with its name."""
    is_file = isinstance(source, str | os.PathLike) and os.fspath(source).endswith(".toml")
    from vffnull.model.toml_text import naming

    return naming(shown(source)) if is_file else nullcontext()  # type: ignore[arg-type]


def _folder(source: str | os.PathLike[str]) -> Path:
    """Where files are that a scenario in a file names."""
    return Path(os.fspath(source)).parent


def document_of(scenario: ScenarioLike) -> Document:
    """The document of what is meant, unchecked, as a copy of its own; its arm needs no other file."""
    return explicit(source_of(scenario))


def _checked(document: Document) -> Document:
    """The document, explicit and found to be one that can be run."""
    found = explicit(document)
    _core.check("scenario", found)
    return found


def shown(source: str | os.PathLike[str]) -> str:
    """A name or a path as it can be printed: bytes of a path that are no text are escaped."""
    return os.fsdecode(source).encode("utf-8", "backslashreplace").decode("utf-8")


def changed(document: Document, overrides: Mapping[str, Any] | None) -> Document:
    """The document itself, with other values for some keys."""
    for name, value in (overrides or {}).items():
        one = name in _LISTS and isinstance(value, HasDocument | Mapping)
        put(document, name, [value] if one else value)
    return document
